// The page that sketches: curves are drawn over a surface, patches shade in as they close, what is missing is told.

import { choiceKey, meshChoice } from "../core/choice.js";
import { client } from "../core/connection.js";
import { h, select } from "../core/dom.js";
import { count, time } from "../core/format.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, on, state } from "../core/state.js";
import { drawTools } from "../view/tools.js";
import { currentStage, setLook, show } from "../view/view.js";

/** @import { EditedLayout, Layout, LayoutBrief, Point } from "../../js/types.js" */
/** @import { Track } from "./pen.js" */

const SNAP_SHARE = 0.02;

/** @param {HTMLElement} panel */
export function showSketch(panel) {
  /** @type {LayoutBrief[]} */
  let layouts = [];
  /** @type {Layout | null} */
  let layout = null;
  /** The chosen curves, and where each was touched. @type {Map<number, Point>} */
  const chosen = new Map();
  let isRedrawing = false;
  let putPenAway = () => {};
  const modules = () => Promise.all([import("./pen.js"), import("./window.js"), import("./drawing.js")]);
  /** @type {Awaited<ReturnType<typeof modules>> | null} */
  let tools = null;

  const side = h("div", { className: "form whole" });
  const outcome = h("p", { className: "outcome muted", id: "sketch", role: "status" });
  const issues = h("ul", { className: "issues", "aria-label": "What is missing" });
  const button = (/** @type {string} */ words, /** @type {() => Promise<unknown>} */ action, title = "") =>
    h("button", { type: "button", title, disabled: true, onclick: () => run(action) }, words);
  const undo = button("Undo", () => edit((id) => client.layouts.undo(id)), "Ctrl+Z");
  const redo = button("Redo", () => edit((id) => client.layouts.redo(id)), "Ctrl+Shift+Z");
  const split = button("Split", () => edit((id) => client.layouts.split(id, firstChosen(), /** @type {Point} */ (chosen.get(firstChosen())))), "Cut the chosen curve where it was touched");
  const merge = button("Merge", () => {
    const [first, second] = chosen.keys();
    return edit((id) => client.layouts.merge(id, first, second));
  }, "Join the two chosen curves");
  const remove = button("Delete", removeChosen, "Delete");
  const redraw = button("Redraw", async () => {
    isRedrawing = true;
    outcome.textContent = "Draw the chosen curve anew.";
  }, "The next stroke takes the chosen curve's place");
  const remesh = h("a", { className: "button", href: "#remesh", hidden: true }, "Remesh");
  panel.append(h("section", { className: "section", "aria-labelledby": "sketch-title" },
    h("header", {}, h("h2", { id: "sketch-title" }, "Sketch"), undo, redo),
    h("div", { className: "form" }, side),
    h("p", { className: "muted" }, "Draw boundary curves on the surface. The right button or two fingers turn the view; a click chooses a curve."),
    h("div", { className: "row" }, split, merge, redraw, remove, remesh), outcome, issues));

  const firstChosen = () => /** @type {number} */ (chosen.keys().next().value);

  async function removeChosen() {
    for (const curve of [...chosen.keys()]) await edit((id) => client.layouts.deleteCurve(id, curve));
  }

  /** Edits go one after the other. @type {Promise<unknown>} */
  let before = Promise.resolve();
  /** @param {(id: string) => Promise<Layout | EditedLayout>} action */
  function edit(action) {
    const next = before.then(async () => {
      if (!layout) return;
      take(await action(layout.id));
    });
    before = next.catch(() => {});
    return next;
  }

  /** @param {Layout | EditedLayout} now */
  function take(now) {
    layout = now;
    chosen.clear();
    isRedrawing = false;
    setParameters({ layout: now.id });
    const missed = "stroke" in now && now.stroke ? now.stroke.missed_points : 0;
    outcome.textContent = `${count(now.curves.length)} curves, ${count(now.patches.length)} patches`
      + (now.complete && now.patches.length > 0 ? "; the layout is whole" : "") + (missed > 0 ? `; ${missed} points of the stroke met nothing` : "");
    draw();
  }

  function draw() {
    undo.disabled = !layout?.can_undo;
    redo.disabled = !layout?.can_redo;
    split.disabled = redraw.disabled = chosen.size !== 1;
    merge.disabled = chosen.size !== 2;
    remove.disabled = chosen.size === 0;
    remesh.hidden = !layout || layout.patches.length === 0;
    remesh.href = `#remesh?a=${state.a}&layout=${layout?.id}`;
    issues.replaceChildren(...(layout?.issues ?? []).map((issue) => h("li", {}, h("button", {
      type: "button", className: "quiet", onclick: () => flyTo(issue.point),
    }, issue.detail))));
    const stage = currentStage();
    if (stage && layout && tools) tools[2].drawLayout(stage, layout, new Set(chosen.keys()));
  }

  /** @param {Point} point */
  function flyTo(point) {
    const stage = currentStage();
    const place = stage?.toScene(point);
    if (stage && place) stage.eye.flyTo(place, 0.9, place.clone());
  }

  /** @param {Track} track */
  async function drawStroke(track) {
    const stage = currentStage();
    if (!stage || !tools || !layout) return;
    if (isRedrawing) {
      const { pick } = await import("../view/pick.js");
      const model = stage.models.get("a");
      const points = model ? track.map(([x, y]) => pick(stage, model, x, y)?.point).filter((point) => point !== undefined) : [];
      if (points.length < 2) throw new Error("The stroke does not meet the surface; a curve over a point set is drawn anew by deleting it first.");
      const curve = firstChosen();
      await edit((id) => client.layouts.redraw(id, curve, /** @type {Point[]} */ (points)));
      return;
    }
    const stroke = tools[1].strokeOf(stage, track);
    const snap = SNAP_SHARE * (meshOf(state.a)?.bounding_box.diagonal ?? 1);
    await edit((id) => client.layouts.stroke(id, { ...stroke, snap }));
  }

  /** @param {number} x @param {number} y */
  function choose(x, y) {
    const stage = currentStage();
    if (!stage || !tools || !layout) return;
    const found = tools[1].curveAt(stage, layout.curves, x, y);
    if (!found) chosen.clear();
    else if (chosen.has(found.curve.id)) chosen.delete(found.curve.id);
    else chosen.set(found.curve.id, found.point);
    draw();
  }

  async function arm() {
    const stage = currentStage();
    if (!stage) return;
    tools ??= await modules();
    putPenAway();
    putPenAway = tools[0].takePen(stage, {
      onStroke: (track) => { run(() => drawStroke(track)); }, onClick: choose,
      snapAt: (x, y) => (tools && layout ? tools[1].nodeAt(stage, layout.nodes, x, y, SNAP_SHARE / stage.frame.scale) : null),
    });
    draw();
  }

  /** The layouts of a mesh; the newest one, or the one of the address, is taken up. */
  async function openLayouts() {
    const mesh = state.a;
    const all = [];
    for await (const brief of client.layouts.list({ pageSize: 1000 })) if (brief.mesh === mesh) all.push(brief);
    if (mesh !== state.a || mesh === null) return;
    layouts = all;
    const wanted = layouts.find(({ id }) => id === parameter("layout")) ?? layouts[layouts.length - 1];
    take(wanted ? await client.layouts.get(wanted.id) : await client.layouts.create({ mesh }));
    if (!wanted && layout) layouts.push(layout);
    drawChoices();
  }

  async function startAnew() {
    if (state.a === null) return;
    const made = await client.layouts.create({ mesh: state.a });
    layouts.push(made);
    take(made);
    drawChoices();
  }

  function drawChoices() {
    const choice = select("layout", layouts.map((brief) => [brief.id, `${time(brief.created)}${brief.complete && brief.revision > 0 ? ", whole" : ""}`]), layout?.id ?? "");
    choice.addEventListener("change", () => run(async () => take(await client.layouts.get(choice.value))));
    side.replaceChildren(meshChoice("a", { words: "Surface" }), h("label", {}, "Layout", choice),
      h("div", { className: "row whole" }, h("button", { type: "button", disabled: state.a === null, onclick: () => run(startAnew) }, "New layout")));
  }

  let drawn = "";
  let view = "nothing yet";
  function onChoice() {
    if (choiceKey() === drawn) return;
    drawn = choiceKey();
    const mesh = meshOf(state.a);
    drawChoices();
    const key = mesh ? `${mesh.id} ${mesh.revision}` : "";
    if (key === view) return;
    view = key;
    layout = null;
    currentStage()?.setOverlay();
    drawTools(mesh ? [mesh] : []);
    show(mesh ? [{ mesh, role: "a", isBilinear: false }] : [], "Choose a mesh or a point set to draw on.").then((isWhole) => { if (isWhole && mesh) run(arm); });
    if (mesh) openLayouts().catch(sayFault);
  }

  /** @param {KeyboardEvent} event */
  function onKey(event) {
    if (event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement) return;
    const isZ = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
    const isY = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y";
    if (isZ && !event.shiftKey) undo.click();
    else if (isZ || isY) redo.click();
    else if (event.key === "Delete" || event.key === "Backspace") remove.click();
    else if (event.key === "Escape") {
      chosen.clear();
      isRedrawing = false;
      draw();
    } else return;
    event.preventDefault();
  }

  setLook({ heat: false, structure: false });
  addEventListener("keydown", onKey);
  onChoice();
  const off = [on(["meshes", "choice"], onChoice), on("theme", draw)];
  return () => {
    off.forEach((each) => each());
    removeEventListener("keydown", onKey);
    putPenAway();
    currentStage()?.setOverlay();
  };
}
