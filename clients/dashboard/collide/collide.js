// The page of collisions: which faces of A and B, or of A itself, meet; else how far apart the two are.

import { client } from "../core/connection.js";
import { choiceKey, meshChoice } from "../core/choice.js";
import { figures, h, select } from "../core/dom.js";
import { count, duration, length } from "../core/format.js";
import { run } from "../core/messages.js";
import { parameter } from "../core/route.js";
import { Search } from "../core/search.js";
import { meshOf, on, state } from "../core/state.js";
import { drawTools } from "../view/tools.js";
import { currentStage, lookAt, setLook, show } from "../view/view.js";

/** @import { CollisionResult, DistanceResult } from "../../js/types.js" */
/** @import { Wish } from "../view/stage.js" */

/** The reading of quads, as it was left. */
let reading = "triangles";

/** @param {HTMLElement} panel */
export function showCollide(panel) {
  /** @type {{ result: CollisionResult, pairs: Float64Array, isSelf: boolean } | null} */
  let found = null;
  let place = 0;
  let asked = 0;
  if (["triangles", "bilinear"].includes(parameter("quads") ?? "")) reading = /** @type {string} */ (parameter("quads"));
  const sides = h("div", { className: "form whole" });
  const quads = select("quads", [["triangles", "two triangles"], ["bilinear", "a bilinear patch"]], reading);
  const find = h("button", { type: "submit", className: "primary" }, "Find collisions");
  const outcome = h("p", { className: "outcome muted", id: "collisions", role: "status" });
  const details = h("div", { className: "section" });
  const searching = new Search();
  const form = h("form", { className: "form", "aria-label": "Collision" }, sides, h("label", {}, "A quad is", quads),
    h("div", { className: "row whole" }, find));
  panel.append(h("section", { className: "section", "aria-labelledby": "collide-title" },
    h("header", {}, h("h2", { id: "collide-title" }, "Collide")), form, outcome, searching.element, details));
  quads.addEventListener("change", () => {
    reading = quads.value;
    forget();
    drawView();
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    run(search);
  });

  async function search() {
    const mine = ++asked;
    const isSelf = state.b === null || state.b === state.a;
    const common = { quads: /** @type {any} */ (reading), limit: 10000 };
    const [a, b] = [/** @type {string} */ (state.a), /** @type {string} */ (state.b)];
    outcome.textContent = "";
    find.disabled = true;
    try {
      const { id, result: answer, isStopped } = await searching.run(isSelf ? { type: "self_collision", mesh: a, ...common } : { type: "collision", a, b, ...common });
      const result = /** @type {CollisionResult} */ (answer);
      const pairs = await client.jobs.pairs(id);
      if (mine !== asked) return;
      found = { result, pairs, isSelf };
      place = 0;
      outcome.textContent = isStopped ? `Stopped: ${meeting(result.count)} so far` : result.collides ? meeting(result.count)
        : isSelf ? "No faces meet that should not" : "The two do not meet";
      details.replaceChildren(figures([["Search", duration(result.elapsed_ms)], ["Exact tests", count(result.tests)]]));
      if (result.collides) details.prepend(stepper(result));
      else if (!isSelf && !isStopped) await measure(a, b);
      await step(0);
    } catch (error) {
      outcome.textContent = "";
      throw error;
    } finally {
      find.disabled = state.a === null;
    }
  }

  /** How far apart they are. @param {string} a @param {string} b */
  async function measure(a, b) {
    const { result: answer } = await searching.run({ type: "distance", a, b, quads: /** @type {any} */ (reading) });
    const result = /** @type {DistanceResult} */ (answer);
    details.prepend(figures([["Least distance", `${length(result.lower, 7)} to ${length(result.upper, 7)}`]], "figures single"));
    const [from, to] = [result.witness.from.point, result.witness.to.point];
    currentStage()?.setPair({ from, to });
    await lookAt([from, to], "the nearest points");
  }

  const where = h("output", { className: "number", id: "contact" });
  /** @param {CollisionResult} result */
  function stepper({ count: all, pairs }) {
    const button = (/** @type {string} */ words, /** @type {string} */ label, /** @type {number} */ by) =>
      h("button", { type: "button", "aria-label": label, onclick: () => run(() => step(by)) }, words);
    const left = all > pairs.length && h("span", { className: "muted small" }, `The first ${count(pairs.length)} of ${count(all)} can be stepped through.`);
    return h("div", { className: "row", role: "group", "aria-label": "Contacts" }, button("◀", "Previous contact", -1), where, button("▶", "Next contact", 1), left);
  }

  /** @param {number} by */
  async function step(by) {
    const stage = currentStage();
    const pairs = found?.result.pairs ?? [];
    if (pairs.length > 0) place = (place + by + pairs.length) % pairs.length;
    const pair = pairs[place] ?? null;
    if (pair) where.textContent = `${count(place + 1)} of ${count(pairs.length)}: faces ${pair.faces[0]} and ${pair.faces[1]}, ${article(pair.contact)}`;
    if (!stage || !found) return;
    const { drawContacts } = await import("./contacts.js");
    await drawContacts(stage, { ...found, current: pair });
    if (pair) await lookAt(pair.points, "the contact", 0.35);
  }

  function forget() {
    asked++;
    searching.leave();
    found = null;
    outcome.textContent = "";
    details.replaceChildren(h("p", { className: "muted" }, "Faces that have a point in common: of A and B, or of A alone when B is A itself."));
    currentStage()?.setOverlay();
    currentStage()?.setPair(null);
    setLook({ through: false });
  }

  let view = "nothing yet";
  function drawView() {
    /** @type {Wish[]} */
    const wishes = [];
    for (const role of /** @type {const} */ (["a", "b"])) {
      const mesh = meshOf(state[role]);
      const isTwice = role === "b" && state.b === state.a;
      if (mesh && !isTwice) wishes.push({ mesh, role, isBilinear: reading === "bilinear", isGhost: role === "b" });
    }
    const key = wishes.map(({ mesh, isBilinear }) => `${mesh.id} ${mesh.revision} ${isBilinear}`).join();
    if (key === view) return;
    view = key;
    drawTools(wishes.map(({ mesh }) => mesh));
    show(wishes, "Choose a mesh to search for collisions.").then((isWhole) => { if (isWhole && found) run(() => step(0)); });
  }

  let drawn = "";
  function draw() {
    if (choiceKey() !== drawn) {
      sides.replaceChildren(meshChoice("a"), meshChoice("b", { none: "A itself" }));
      forget();
    }
    drawn = choiceKey();
    find.disabled = state.a === null;
    drawView();
  }

  setLook({ heat: false, structure: false });
  draw();
  const off = on(["meshes", "choice"], draw);
  return () => {
    off();
    forget();
  };
}

/** @param {number} number of pairs */
const meeting = (number) => `${count(number)} pair${number === 1 ? "" : "s"} of faces meet`;

/** @param {string} contact */
const article = (contact) => `${contact === "area" ? "an" : "a"} ${contact}`;
