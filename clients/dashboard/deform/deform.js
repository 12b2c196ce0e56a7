// The page that deforms: a region of the mesh is dragged, the daemon refits its trees and tells which faces meet.

import { choiceKey, meshChoice } from "../core/choice.js";
import { refreshMeshes } from "../core/data.js";
import { colour, figures, h } from "../core/dom.js";
import { count, duration } from "../core/format.js";
import { run, say, sayFault } from "../core/messages.js";
import { setParameters } from "../core/route.js";
import { changed, meshOf, nameOf, on, state } from "../core/state.js";
import { drawTools } from "../view/tools.js";
import { currentStage, setLook, show } from "../view/view.js";
import { Sender } from "./sender.js";

/** @import { Hold } from "./drag.js" */
/** @import { Round } from "./sender.js" */

const STEP = 0.03;
/** The handle's radius, as a share of the diagonal. */
let radius = 0.15;

/** @param {HTMLElement} panel */
export function showDeform(panel) {
  const side = h("div", { className: "whole" });
  const slider = h("input", { type: "range", min: "0.02", max: "0.5", step: "0.01", value: String(radius) });
  const undo = h("button", { type: "button", disabled: true, onclick: () => run(goBack) }, "Undo");
  const middle = h("button", { type: "button", onclick: () => run(takeMiddle) }, "Take the middle of the view");
  const pull = h("button", { type: "button", disabled: true, onclick: () => push(STEP) }, "Pull out");
  const pressIn = h("button", { type: "button", disabled: true, onclick: () => push(-STEP) }, "Push in");
  const outcome = h("p", { className: "outcome muted", id: "folds", role: "status" });
  const numbers = h("div");
  panel.append(h("section", { className: "section", "aria-labelledby": "deform-title" },
    h("header", {}, h("h2", { id: "deform-title" }, "Deform"), undo),
    h("p", { className: "muted" }, "Drag the surface; beside it, the view turns. Faces that come to meet are red. The first drag makes a copy: the mesh itself stays as it is."),
    h("div", { className: "form" }, side, h("label", { className: "whole" }, "Radius of the handle", slider),
      h("div", { className: "row whole" }, middle, pull, pressIn)),
    outcome, numbers));
  slider.addEventListener("input", () => { radius = Number(slider.value); });

  const sender = new Sender(showRound, sayFault, (copy) => {
    say(`This is ${copy.name} from now on; ${nameOf(state.a)} stays as it was.`);
    state.meshes = [...state.meshes, copy];
    state.a = copy.id;
    setParameters({ a: copy.id });
    changed("meshes", "choice");
  });
  const allowUndo = () => { undo.disabled = Sender.undosOf(state.a).length === 0; };
  /** @type {Hold | null} */
  let hold = null;
  let pushed = 0;
  let stopListening = () => {};
  const model = () => currentStage()?.models.get("a");

  /** @param {Round} round */
  function showRound(round) {
    const { collisions } = round;
    outcome.textContent = collisions.collides ? `${count(collisions.count)} pair${collisions.count === 1 ? "" : "s"} of faces meet` : "No faces meet";
    outcome.classList.toggle("fault", collisions.collides);
    numbers.replaceChildren(figures([
      ["Revision", count(round.revision)], ["Vertices moved", count(round.moved)], ["Refit", duration(round.refit_ms)],
      ["Boxes updated", count(round.updated_nodes)], ["Search", duration(collisions.elapsed_ms)],
      ["Round trip", duration(round.round_ms)]]));
    allowUndo();
    run(() => drawFolds(round));
  }

  /** @param {Round} round */
  async function drawFolds({ pairs }) {
    const [{ outline }, { toVector }] = await Promise.all([import("../view/loader.js"), import("../view/stage.js")]);
    const stage = currentStage();
    const shown = model();
    if (!stage || !shown) return;
    const triangles = await outline(shown, new Set(pairs), stage.frame);
    stage.setOverlay({ fills: [{ triangles, colour: toVector(colour("--fault")), opacity: 0.85 }] });
  }

  /** @param {Hold} taken */
  async function take(taken) {
    const shown = model();
    if (!shown) return;
    hold = taken;
    pushed = 0;
    await sender.take(shown, taken.point, radius * shown.mesh.bounding_box.diagonal);
    pull.disabled = pressIn.disabled = false;
  }

  async function takeMiddle() {
    const stage = currentStage();
    const shown = model();
    if (!stage || !shown) return;
    const { pick } = await import("../view/pick.js");
    const found = pick(stage, shown, stage.canvas.clientWidth / 2, stage.canvas.clientHeight / 2);
    if (!found) throw new Error("There is no surface in the middle of the view.");
    await take(found);
    outcome.textContent = "The handle is taken; pull it out or push it in.";
  }

  /** @param {number} by a share of the diagonal, along the surface's normal */
  function push(by) {
    const diagonal = model()?.mesh.bounding_box.diagonal ?? 0;
    pushed += by;
    sender.move((hold?.normal ?? []).map((value) => value * pushed * diagonal));
  }

  async function goBack() {
    const id = /** @type {string} */ (state.a);
    await sender.undo(id);
    hold = null;
    pull.disabled = pressIn.disabled = true;
    allowUndo();
    currentStage()?.setOverlay();
    numbers.replaceChildren();
    outcome.classList.remove("fault");
    outcome.textContent = "The last drag is undone.";
    await refreshMeshes();
  }

  /** @type {Promise<void>} */
  let taking = Promise.resolve();
  async function listen() {
    const stage = currentStage();
    const shown = model();
    if (!stage || !shown) return;
    const [{ listenToDrags }, { prepare }] = await Promise.all([import("./drag.js"), import("../view/pick.js")]);
    stopListening();
    stopListening = listenToDrags(stage, {
      model,
      onTake: (taken) => { taking = take(taken).catch(sayFault); },
      onMove: (offset) => { taking.then(() => sender.move(offset)); },
      onRelease: () => { taking.then(allowUndo); },
    });
    await prepare(shown);
  }

  let view = "nothing yet";
  function drawView() {
    const mesh = meshOf(state.a);
    const key = mesh ? `${mesh.id} ${mesh.revision}` : "";
    const isShown = mesh !== undefined && model()?.mesh.id === mesh.id && model()?.mesh.revision === mesh.revision;
    if (key === view || (isShown && view !== "nothing yet")) return;
    view = key;
    drawTools(mesh ? [mesh] : []);
    show(mesh ? [{ mesh, role: "a", isBilinear: false }] : [], "Choose a mesh to deform.").then((isWhole) => {
      if (isWhole && mesh) run(listen);
    });
  }

  let drawn = "";
  function draw() {
    if (choiceKey() !== drawn) side.replaceChildren(meshChoice("a", { words: "Mesh", fits: (mesh) => mesh.kind !== "points" }));
    if (drawn !== "" && choiceKey() !== drawn) currentStage()?.setOverlay();
    drawn = choiceKey();
    middle.disabled = state.a === null;
    allowUndo();
    drawView();
  }

  setLook({ heat: false, structure: false });
  draw();
  const off = on(["meshes", "choice"], draw);
  return () => {
    off();
    stopListening();
    currentStage()?.setOverlay();
  };
}
