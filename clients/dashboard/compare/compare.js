// The page that compares two meshes: both bounds run towards each other, the farthest points, the heat map.

import { byId, h } from "../core/dom.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, nameOf, on, state } from "../core/state.js";
import { paint } from "../view/loader.js";
import { drawTools, toggle } from "../view/tools.js";
import { currentStage, setLook, show } from "../view/view.js";
import { drawDeviation, makeLegend, measureDeviation } from "./deviation.js";
import { copyLink, saveBounds, saveDistances, savePicture } from "./exports.js";
import { makeForm, readRequest, settings } from "./form.js";
import { Measurement } from "./measurement.js";
import { makeOutcome } from "./outcome.js";

/** @import { Deviation } from "./deviation.js" */
/** @import { Wish } from "../view/stage.js" */

/** @param {HTMLElement} panel */
export function showCompare(panel) {
  for (const name of /** @type {const} */ (["direction", "quads", "tolerance", "threshold"])) settings[name] = parameter(name) ?? settings[name];
  const shown = { a: true, b: true };
  /** @type {Deviation | null} */
  let deviation = null;
  let leaveDeviation = new AbortController();
  let redrawHistogram = () => {};
  let isFollowed = false;
  let pairKey = "";
  let view = "nothing yet";
  setLook({ structure: false });

  const measurement = new Measurement(() => requestDraw());
  const outcome = makeOutcome();
  const form = makeForm({ onMeasure: () => measure(), onStop: () => run(() => measurement.stop()), onReading: () => { drawView(); forgetHeat(); } });
  const fly = h("button", { type: "button", disabled: true, onclick: () => currentStage()?.flyToPair() }, "Show the farthest points");
  const heat = h("button", { type: "button", onclick: () => run(() => paintHeat()) }, "Map the distances");
  const distances = h("div", { className: "section" });
  const csv = h("button", { type: "button", disabled: true, onclick: () => saveBounds(measurement) }, "Bounds, CSV");
  const distancesCsv = h("button", { type: "button", disabled: true, onclick: () => deviation && saveDistances(deviation) }, "Distances, CSV");
  panel.append(
    h("section", { className: "section", "aria-labelledby": "compare-title" }, h("header", {}, h("h2", { id: "compare-title" }, "Compare")), form.form),
    h("section", { className: "section", "aria-labelledby": "distance-title" },
      h("header", {}, h("h2", { id: "distance-title" }, "Hausdorff distance"), fly), outcome.element),
    h("section", { className: "section", "aria-labelledby": "deviation-title" },
      h("header", {}, h("h2", { id: "deviation-title" }, "Deviation of A from B"), heat), distances),
    h("section", { className: "section", "aria-labelledby": "take-title" },
      h("h2", { id: "take-title" }, "Take along"),
      h("div", { className: "row" }, h("button", { type: "button", onclick: () => run(copyLink) }, "Copy link"),
        h("button", { type: "button", onclick: () => run(() => savePicture(deviation ? deviation.result.max.upper : null)) }, "Picture, PNG"),
        csv, distancesCsv)));

  let isWaiting = false;
  /** Events may come faster than the screen shows them. */
  function requestDraw() {
    if (isWaiting) return;
    isWaiting = true;
    requestAnimationFrame(() => {
      isWaiting = false;
      draw();
    });
  }

  function draw() {
    form.draw(measurement.isRunning);
    const request = measurement.job?.request;
    outcome.draw(measurement, request?.threshold ?? (settings.threshold === "" ? null : Number(settings.threshold)));
    csv.disabled = measurement.samples.length === 0;
    distancesCsv.disabled = deviation === null;
    heat.disabled = state.a === null || state.b === null || heat.dataset.busy !== undefined;
    showPair();
  }

  function showPair() {
    const witness = measurement.result?.witness;
    const isSamePair = measurement.job?.request.a === state.a && measurement.job?.request.b === state.b;
    fly.disabled = !witness || !isSamePair || !currentStage();
    const points = witness && isSamePair ? { from: witness.from.point, to: witness.to.point } : null;
    const key = currentStage() ? JSON.stringify([points, currentStage()?.frame]) : "";
    if (key !== pairKey) currentStage()?.setPair(points);
    pairKey = key;
    if (!witness || !isSamePair || isFollowed || !currentStage()) return;
    isFollowed = true;
    if (!parameter("eye")) currentStage()?.flyToPair();
  }

  function drawView() {
    /** @type {Wish[]} */
    const wishes = [];
    const isBilinear = settings.quads === "bilinear";
    for (const role of /** @type {const} */ (["a", "b"])) {
      const mesh = meshOf(state[role]);
      if (mesh) wishes.push({ mesh, role, isBilinear, isHidden: !shown[role], isGhost: role === "b" && shown.a });
    }
    const key = wishes.map((wish) => `${wish.role} ${wish.mesh.id} ${wish.mesh.revision} ${isBilinear} ${wish.isHidden} ${wish.isGhost}`).join();
    if (key === view) return;
    view = key;
    drawTools(wishes.map(({ mesh }) => mesh), { more: [
      toggle("A", "Show A", shown.a, (isOn) => { shown.a = isOn; drawView(); }),
      toggle("B", "Show B", shown.b, (isOn) => { shown.b = isOn; drawView(); })] });
    show(wishes, "Choose two meshes to compare.").then((isWhole) => {
      if (!isWhole) return;
      const eye = parameter("eye");
      if (eye) currentStage()?.eye.fromText(eye);
      showPair();
      if (deviation) paintValues(deviation);
      else if (parameter("heat") && heat.dataset.busy === undefined) run(() => paintHeat());
    });
  }

  function measure() {
    isFollowed = false;
    setParameters({ ...settings, a: state.a, b: state.b, job: null, eye: null });
    measurement.ask(readRequest()).then(() => setParameters({ job: measurement.job?.id }));
  }

  async function paintHeat() {
    if (state.a === null || state.b === null) return;
    heat.dataset.busy = "yes";
    heat.disabled = true;
    distances.replaceChildren(h("p", { className: "muted", role: "status" }, "Measuring the distances over A …"));
    leaveDeviation = new AbortController();
    const { signal } = leaveDeviation;
    const names = { a: nameOf(state.a), b: nameOf(state.b) };
    try {
      deviation = await measureDeviation({ a: state.a, b: state.b, quads: settings.quads }, signal);
      const drawn = drawDeviation(deviation, names);
      distances.replaceChildren(drawn.element);
      redrawHistogram = drawn.redraw;
      drawn.redraw();
      setParameters({ heat: 1 });
      await paintValues(deviation);
    } catch (error) {
      distances.replaceChildren();
      sayFault(error);
    } finally {
      delete heat.dataset.busy;
      draw();
    }
  }

  /** @param {Deviation} painted */
  async function paintValues(painted) {
    const model = currentStage()?.models.get("a");
    const top = painted.result.max.upper;
    if (!model?.isWhole || model.mesh.vertices !== painted.distances.length) return;
    await paint(model, painted.distances);
    if (painted !== deviation) return;
    setLook({ heat: true, top: top > 0 ? top : 1 });
    byId("stage-legend").replaceChildren(makeLegend(top));
  }

  function forgetHeat() {
    leaveDeviation.abort();
    deviation = null;
    distances.replaceChildren(h("p", { className: "muted" }, "How far each part of A lies from B: colours on A, a histogram and percentiles."));
    byId("stage-legend").replaceChildren();
    setLook({ heat: false });
  }

  let pair = "";
  function onChoice() {
    if (`${state.a} ${state.b}` !== pair) {
      const isFirst = pair === "";
      pair = `${state.a} ${state.b}`;
      if (!isFirst) setParameters({ a: state.a, b: state.b, heat: null, eye: null });
      forgetHeat();
    }
    drawView();
    draw();
  }

  const job = parameter("job");
  if (job) {
    isFollowed = parameter("eye") !== null;
    measurement.open(job).then((opened) => {
      if (!opened || opened.type !== "hausdorff") return;
      form.fill(opened.request);
      [state.a, state.b] = [opened.request.a, opened.request.b];
      onChoice();
    });
  }
  onChoice();
  const resize = new ResizeObserver(() => { draw(); redrawHistogram(); });
  resize.observe(panel);
  const forget = [on(["meshes", "choice"], onChoice), on("theme", () => { draw(); redrawHistogram(); })];
  return () => {
    forget.forEach((off) => off());
    resize.disconnect();
    measurement.leave();
    forgetHeat();
    currentStage()?.setPair(null);
  };
}
