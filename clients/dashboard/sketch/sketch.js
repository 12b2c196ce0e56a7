// The page that sketches: curves are drawn over a surface, patches shade in as they close, what is missing is told.

import { choiceKey, meshChoice } from "../core/choice.js";
import { NUMBER, h, numberOf, select } from "../core/dom.js";
import { count, time } from "../core/format.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, on, state } from "../core/state.js";
import { drawTools, toggle } from "../view/tools.js";
import { currentStage, lookAt, setLook, show } from "../view/view.js";
import { Editor } from "./editor.js";
import { Suggestions } from "./suggest.js";
import { Tools } from "./tools.js";

/** @import { Layout } from "../../js/types.js" */
/** @import { DepthMap } from "../view/depth.js" */
/** @import { Stage } from "../view/stage.js" */
/** @import { Track } from "./pen.js" */
/** @import { Held } from "./tools.js" */
/** @import { Target } from "./window.js" */

const GRIP_REACH = 14;

/** @param {HTMLElement} panel */
export function showSketch(panel) {
  const editor = new Editor(draw);
  const modules = () => Promise.all([import("./pen.js"), import("./window.js"), import("./drawing.js"), import("../view/depth.js")]);
  /** @type {Awaited<ReturnType<typeof modules>> | null} */
  let tools = null;
  /** @type {DepthMap | null} */
  let depth = null;
  /** @type {{ look: () => void, putAway: () => void } | null} */
  let pen = null;
  let isTurning = false;

  const side = h("div", { className: "form" });
  const summary = h("p", { className: "outcome", id: "sketch", role: "status" });
  const words = h("p", { className: "outcome muted", id: "sketch-words", role: "status" });
  const issues = h("ul", { className: "issues" });
  const missing = h("section", { className: "section", "aria-labelledby": "missing-title", hidden: true },
    h("h2", { id: "missing-title" }, "What is missing"), issues);
  const button = (/** @type {string} */ name, /** @type {() => Promise<unknown>} */ action, title = "") =>
    h("button", { type: "button", title, disabled: true, onclick: (/** @type {MouseEvent} */ event) => {
      // Who clicked goes on drawing: Space turns the view then, and does not press the button again.
      if (event.detail > 0) currentStage()?.canvas.focus({ preventScroll: true });
      run(action);
    } }, name);
  const undo = button("Undo", () => editor.undo(), "Ctrl+Z");
  const redo = button("Redo", () => editor.redo(), "Ctrl+Shift+Z");
  const curve = h("select", { name: "curve" });
  const split = button("Split", () => editor.split(), "Cut the chosen curve where it was touched");
  const merge = button("Merge", () => editor.merge(), "Join the two chosen curves");
  const remove = button("Delete", () => editor.delete(), "Delete");
  const redraw = button("Redraw", async () => {
    editor.isRedrawing = true;
    words.textContent = "Redraw the chosen curve; it stays between its nodes. Escape leaves it as it is.";
  }, "The next stroke takes the chosen curve's place");
  const discard = button("Delete layout", async () => editor.discard());
  const remesh = h("a", { className: "button primary", href: "#remesh", hidden: true }, "Remesh this layout");
  const field = (/** @type {string} */ name, /** @type {string} */ placeholder) =>
    h("input", { name, placeholder, inputMode: "numeric", autocomplete: "off", pattern: NUMBER, title: "a number" });
  const [quads, patches] = [field("quad_count", "5000"), field("patches", "as few as are found")];
  const make = h("button", { type: "submit", className: "primary" }, "Make a layout");
  const automatic = h("form", { className: "form", "aria-label": "Automatic layout" }, h("label", {}, "By about so many quads", quads),
    h("label", {}, "Patches", patches), h("div", { className: "row whole" }, make));
  automatic.addEventListener("submit", (event) => {
    event.preventDefault();
    run(makeLayout);
  });
  const toolbox = new Tools(editor, button);
  const suggestions = new Suggestions(editor, button, draw);
  panel.append(
    h("section", { className: "section", "aria-labelledby": "sketch-title" },
      h("header", {}, h("h2", { id: "sketch-title" }, "Sketch"), undo, redo), side,
      h("p", { className: "muted small" }, "Draw boundary curves on the surface until cells of four sides cover it. The right button,"
        + " or two fingers, turn the view; the middle one moves it. Ends snap to nodes and curves within 12 pixels, and strokes to creases; with Alt to none."
        + " A click chooses a curve; the ends of a chosen one can be dragged. A closed stroke is cut into four."
        + " By keyboard, in the view: D shows a pen that the arrow keys move; D puts it down, and lifts it.")),
    h("section", { className: "section", "aria-labelledby": "automatic-title" }, h("h2", { id: "automatic-title" }, "Automatic layout"), automatic),
    toolbox.element,
    h("section", { className: "section", "aria-label": "Curves" },
      summary, words, h("div", { className: "row" }, h("label", { className: "inline" }, "Curve", curve)),
      h("div", { className: "row" }, split, merge, redraw, remove), h("div", { className: "row" }, remesh, discard)),
    missing, suggestions.element);
  curve.addEventListener("change", () => {
    editor.chosen.clear();
    const found = editor.layout?.curves.find(({ id }) => String(id) === curve.value);
    if (found) editor.chosen.set(found.id, found.points[Math.floor(found.points.length / 2)]);
    draw();
  });

  function draw() {
    const { layout, chosen } = editor;
    if (layout) setParameters({ layout: layout.id });
    undo.disabled = !layout?.can_undo;
    redo.disabled = !layout?.can_redo;
    split.disabled = redraw.disabled = chosen.size !== 1;
    merge.disabled = chosen.size !== 2;
    remove.disabled = chosen.size === 0;
    discard.disabled = layout === null;
    toolbox.update();
    suggestions.update();
    remesh.hidden = !layout || layout.patches.length === 0;
    remesh.href = `#remesh?a=${state.a}&layout=${layout?.id}`;
    summary.textContent = state.a === null ? "" : describe(layout);
    words.textContent = editor.words;
    drawCurves();
    drawMake();
    missing.hidden = !layout || layout.issues.length === 0;
    issues.replaceChildren(...(layout?.issues ?? []).map((issue) => h("li", {}, h("button", {
      type: "button", className: "quiet", onclick: () => run(() => lookAt([issue.point], "the place", 0.9)),
    }, issue.detail))));
    if (layouts() !== drawnLayouts) drawChoices();
    drawView();
  }

  let isMaking = false;
  async function makeLayout() {
    const wanted = { quad_count: numberOf(quads.value) ?? undefined, patches: numberOf(patches.value) ?? undefined, symmetry: toolbox.symmetry };
    isMaking = true;
    words.textContent = "A layout is being made of the whole surface.";
    drawMake();
    try {
      await editor.make(wanted);
    } finally {
      isMaking = false;
      words.textContent = editor.words;
      drawMake();
    }
  }

  function drawMake() {
    make.disabled = isMaking || !meshOf(state.a);
    make.title = "Of the whole surface; with a mirror plane both sides are alike.";
  }

  function drawCurves() {
    const { layout, chosen } = editor;
    const none = chosen.size === 2 ? [...chosen.keys()].join(" and ") : "none";
    curve.replaceChildren(h("option", { value: "" }, none),
      ...(layout?.curves ?? []).map(({ id }) => h("option", { value: String(id), selected: id === editor.curve }, String(id))));
    curve.disabled = !layout || layout.curves.length === 0;
  }

  /** @type {Layout | null} */
  let shaded = null;
  function drawView() {
    const stage = currentStage();
    if (!stage || !tools || !stage.models.get("a")?.isWhole) return;
    const { layout, chosen } = editor;
    if (!layout) stage.setOverlay();
    else tools[2].drawLayout(stage, layout, new Set(chosen.keys()), suggestions.shown);
    if (shaded === layout) return;
    shaded = layout;
    run(() => /** @type {NonNullable<typeof tools>} */ (tools)[2].shadePatches(stage, layout ?? { ...EMPTY }));
  }

  /** @param {number} x @param {number} y */
  function choose(x, y) {
    const stage = currentStage();
    const { layout, chosen } = editor;
    if (!stage || !tools || !layout) return;
    const found = tools[1].curveAt(stage, layout.curves, x, y, isSeen);
    editor.isRedrawing = false;
    if (!found) chosen.clear();
    else if (chosen.has(found.curve.id)) chosen.delete(found.curve.id);
    else {
      if (chosen.size === 2) chosen.clear();
      chosen.set(found.curve.id, found.point);
    }
    draw();
  }

  /** @param {number} x @param {number} y */
  function markAt(x, y) {
    const stage = currentStage();
    if (!stage || !tools || !editor.layout) return;
    const target = targetOf(stage, x, y);
    const found = tools[1].curveAt(stage, editor.layout.curves, x, y, isSeen);
    run(() => toolbox.mark(target?.kind === "node" ? toolbox.nodeOf(target.point) : -1, found ? found.curve.id : -1));
  }

  const isSeen = (/** @type {import("three").Vector3} */ place) => depth?.isSeen(place) ?? true;

  /** What is drawn at a place of the window. @param {Stage} stage @param {number} x @param {number} y */
  const targetOf = (stage, x, y) => (editor.layout && tools ? tools[1].targetAt(stage, editor.layout, x, y, tools[1].snapRadius(stage, x, y), isSeen) : null);

  /** What a stroke would hold: with Link and Move what is drawn there, else an end of the one chosen curve. @param {number} x @param {number} y */
  function gripAt(x, y) {
    const stage = currentStage();
    if (stage && tools && toolbox.kind !== "draw") {
      const found = editor.layout && tools[1].curveAt(stage, editor.layout.curves, x, y, isSeen);
      return toolbox.held(targetOf(stage, x, y), found ? found.curve.id : -1);
    }
    const held = editor.layout?.curves.find(({ id }) => id === editor.curve);
    if (!stage || !tools || !held || editor.isRedrawing) return null;
    for (const end of /** @type {const} */ (["from", "to"])) {
      const [ex, ey] = tools[1].toWindow(stage, held.points[end === "from" ? 0 : held.points.length - 1]);
      if (Math.hypot(ex - x, ey - y) < GRIP_REACH) return end;
    }
    return null;
  }

  /** @param {Stage} stage @param {"from" | "to"} end @param {Target | null} target */
  async function dropEnd(stage, end, target) {
    if (!target || !tools) throw new Error("An end of a curve goes onto a node or another curve; there is neither.");
    await editor.snap(end, target.point, tools[1].snapRadius(stage, target.x, target.y));
  }

  /** @param {boolean} isOn */
  function setTurning(isOn) {
    isTurning = isOn;
    takeUp();
  }

  /** Takes up the pen, or puts it away to turn the view with it. */
  function takeUp() {
    const stage = currentStage();
    pen?.putAway();
    pen = null;
    if (!stage || !tools || isTurning) return;
    const { snapRadius, strokeOf } = tools[1];
    /** @param {Track} track @param {boolean} isFree */
    const bodyOf = (track, isFree) => {
      const snap = Math.max(...[track[0], track[track.length - 1]].map((place) => snapRadius(stage, ...place)));
      const holds = !editor.isRedrawing && !isFree;
      const features = holds && toolbox.kind === "draw" && meshOf(state.a)?.kind !== "points" ? { reach: snap } : undefined;
      return { ...strokeOf(stage, track), ...(holds ? { snap } : {}), features, mirror: editor.isRedrawing ? undefined : toolbox.mirror };
    };
    pen = tools[0].takePen(stage, {
      onStroke: (track, isFree) => {
        if (toolbox.kind === "ring") run(() => toolbox.ring(bodyOf(track, isFree)));
        else if (toolbox.kind === "draw" || editor.isRedrawing) run(() => editor.stroke(bodyOf(track, isFree)));
      },
      onClick: (x, y) => {
        if (toolbox.kind === "ring") run(() => toolbox.ring(bodyOf([[x, y]], false)));
        else if (toolbox.kind === "mark") markAt(x, y);
        else choose(x, y);
      },
      gripAt,
      onDrop: (/** @type {"from" | "to" | Held} */ grip, target, track) => {
        run(() => (typeof grip === "string" ? dropEnd(stage, grip, target) : toolbox.drop(grip, target, strokeOf(stage, track))));
      },
      targetAt: (x, y) => targetOf(stage, x, y),
    });
  }

  async function arm() {
    const stage = currentStage();
    if (!stage || state.a === null) return;
    tools ??= await modules();
    depth?.dispose();
    depth = new tools[3].DepthMap(stage, () => pen?.look());
    shaded = null;
    takeUp();
    drawView();
    const model = stage.models.get("a");
    if (model && model.mesh.kind !== "points") await (await import("../view/pick.js")).prepare(model);
  }

  const layouts = () => `${editor.layout?.id} ${editor.layouts.map(({ id }) => id)}`;
  let drawnLayouts = "";
  function drawChoices() {
    drawnLayouts = layouts();
    const all = editor.layouts.map((brief) => /** @type {[string, string]} */ ([brief.id, `of ${time(brief.created)}`]));
    const choice = select("layout", [["", "new"], ...all], editor.layout?.id ?? "");
    choice.addEventListener("change", () => run(() => editor.choose(choice.value)));
    side.replaceChildren(meshChoice("a", { words: "Surface" }), h("label", {}, "Layout", choice));
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
    currentStage()?.setOverlay();
    drawTools(mesh ? [mesh] : [], { more: [toggle("Turn", "Turn the view instead of drawing (hold Space)", isTurning, setTurning)] });
    show(mesh ? [{ mesh, role: "a", isBilinear: false }] : [], "Choose a mesh or a point set to draw on.").then((isWhole) => { if (isWhole && mesh) run(arm); });
    editor.open(mesh?.id ?? null, parameter("layout")).then(drawChoices, sayFault);
  }

  /** @param {KeyboardEvent} event */
  function onKey(event) {
    if (event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement) return;
    const key = event.ctrlKey || event.metaKey ? `ctrl ${event.key.toLowerCase()}` : event.key;
    if (key === "ctrl z" && !event.shiftKey) undo.click();
    else if (key === "ctrl z" || key === "ctrl y") redo.click();
    else if (key === "Delete" || key === "Backspace") remove.click();
    else if (key === " " && !(event.target instanceof HTMLButtonElement)) {
      if (!event.repeat) setTurning(true);
    } else if (key === "Escape") {
      editor.chosen.clear();
      editor.isRedrawing = false;
      editor.words = "";
      draw();
    } else return;
    event.preventDefault();
  }
  /** @param {KeyboardEvent} event */
  const onKeyUp = (event) => { if (event.key === " " && !(event.target instanceof HTMLButtonElement)) setTurning(false); };

  setLook({ heat: false, structure: false });
  addEventListener("keydown", onKey);
  addEventListener("keyup", onKeyUp);
  onChoice();
  draw();
  const off = [on(["meshes", "choice"], onChoice), on("theme", draw)];
  return () => {
    off.forEach((each) => each());
    editor.leave();
    removeEventListener("keydown", onKey);
    removeEventListener("keyup", onKeyUp);
    pen?.putAway();
    depth?.dispose();
    currentStage()?.models.get("a")?.setRegions(null);
    setLook({ through: false });
    currentStage()?.setOverlay();
  };
}

const EMPTY = /** @type {Layout} */ (/** @type {unknown} */ ({ nodes: [], curves: [], patches: [], issues: [] }));

/** @param {Layout | null} layout */
function describe(layout) {
  if (!layout || layout.curves.length === 0) return "Nothing is drawn yet.";
  const curves = `${count(layout.curves.length)} curve${layout.curves.length === 1 ? "" : "s"}`;
  const patches = `${count(layout.patches.length)} patch${layout.patches.length === 1 ? "" : "es"}`;
  return `${curves}, ${patches}${layout.complete && layout.patches.length > 0 ? "; every cell is closed" : ""}`;
}
