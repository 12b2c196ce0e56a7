// The page that compares two meshes: both bounds run towards each other, the farthest points, the heat map.

import { h } from "../core/dom.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, nameOf, on, state } from "../core/state.js";
import { drawTools, toggle } from "../view/tools.js";
import { currentStage, look, setLook, show } from "../view/view.js";
import { drawDeviation } from "./deviation.js";
import { copyLink, saveBounds, saveDistances, savePicture } from "./exports.js";
import { makeForm, readRequest, settings } from "./form.js";
import { Heat } from "./heat.js";
import { Measurement } from "./measurement.js";
import { makeOutcome } from "./outcome.js";

/** @import { Wish } from "../view/stage.js" */

/** @param {HTMLElement} panel */
export function showCompare(panel) {
  for (const name of /** @type {const} */ (["direction", "quads", "tolerance", "threshold"])) settings[name] = parameter(name) ?? settings[name];
  const hidden = (parameter("hide") ?? "").split("");
  const shown = { a: !hidden.includes("a"), b: !hidden.includes("b") };
  const heat = new Heat();
  heat.isSigned = parameter("signed") === "1";
  let redrawHistogram = () => {};
  let isFollowed = false;
  let pairKey = "";
  let view = "nothing yet";
  setLook({ structure: false, ...(parameter("edges") ? { wire: true } : {}) });

  const measurement = new Measurement(() => requestDraw());
  const outcome = makeOutcome();
  const form = makeForm({ onMeasure: () => measure(), onStop: () => run(() => measurement.stop()), onReading: () => { drawView(); forgetHeat(); } });
  const fly = h("button", { type: "button", disabled: true, onclick: () => currentStage()?.flyToPair() }, "Show the farthest points");
  const map = h("button", { type: "button", onclick: () => run(() => paintHeat()) }, "Map the distances");
  const sign = toggle("Signed", "Tell what lies outside B from what lies inside", heat.isSigned, (isOn) => {
    heat.isSigned = isOn;
    setParameters({ signed: isOn ? 1 : null });
    run(async () => {
      await heat.paint();
      draw();
    });
  });
  const distances = h("div", { className: "section" });
  const csv = h("button", { type: "button", disabled: true, onclick: () => saveBounds(measurement) }, "Bounds, CSV");
  const distancesCsv = h("button", { type: "button", disabled: true, onclick: () => saveDistances(heat) }, "Distances, CSV");
  panel.append(
    h("section", { className: "section", "aria-labelledby": "compare-title" }, h("header", {}, h("h2", { id: "compare-title" }, "Compare")), form.form),
    h("section", { className: "section", "aria-labelledby": "distance-title" },
      h("header", {}, h("h2", { id: "distance-title" }, "Hausdorff distance"), fly), outcome.element),
    h("section", { className: "section", "aria-labelledby": "deviation-title" },
      h("header", {}, h("h2", { id: "deviation-title" }, "Deviation of A from B"), map), distances),
    h("section", { className: "section", "aria-labelledby": "take-title" },
      h("h2", { id: "take-title" }, "Take along"),
      h("div", { className: "row" }, h("button", { type: "button", onclick: () => run(() => copyLink(lookOfLink())) }, "Copy link"),
        h("button", { type: "button", onclick: () => run(() => savePicture(heat.scale)) }, "Picture, PNG"),
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
    distancesCsv.disabled = heat.deviation === null;
    map.disabled = state.a === null || state.b === null || map.dataset.busy !== undefined;
    sign.disabled = !heat.hasSides;
    showPair();
  }

  /** What a link says of the look. @returns {Record<string, string>} */
  function lookOfLink() {
    const away = (shown.a ? "" : "a") + (shown.b ? "" : "b");
    return { ...(look.wire ? { edges: "1" } : {}), ...(away ? { hide: away } : {}) };
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
      if (heat.deviation) run(() => heat.paint());
      else if (parameter("heat") && map.dataset.busy === undefined) run(() => paintHeat());
    });
  }

  function measure() {
    isFollowed = false;
    setParameters({ ...settings, a: state.a, b: state.b, job: null, eye: null });
    measurement.ask(readRequest()).then(() => setParameters({ job: measurement.job?.id }));
  }

  async function paintHeat() {
    if (state.a === null || state.b === null) return;
    map.dataset.busy = "yes";
    map.disabled = true;
    distances.replaceChildren(h("p", { className: "muted", role: "status" }, "Measuring the distances over A …"));
    const names = { a: nameOf(state.a), b: nameOf(state.b) };
    try {
      const drawn = drawDeviation(await heat.measure({ a: state.a, b: state.b, quads: settings.quads }), names);
      distances.replaceChildren(h("div", { className: "row" }, sign), drawn.element);
      redrawHistogram = drawn.redraw;
      drawn.redraw();
      setParameters({ heat: 1 });
      if (shown.a && !parameter("eye")) shown.b = false; // its ghost would dull the colours
      drawView();
      await heat.paint();
    } catch (error) {
      distances.replaceChildren();
      sayFault(error);
    } finally {
      delete map.dataset.busy;
      draw();
    }
  }

  function forgetHeat() {
    heat.forget();
    distances.replaceChildren(h("p", { className: "muted" }, "How far each part of A lies from B: colours on A, a histogram and percentiles."));
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
