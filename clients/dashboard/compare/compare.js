// The page that compares two meshes: both bounds run towards each other, the farthest points, the heat map.

import { h } from "../core/dom.js";
import { run } from "../core/messages.js";
import { isMoved, keepPose, poseOfA, setPoseParameter } from "../core/pose.js";
import { parameter, setParameters } from "../core/route.js";
import { changed, meshOf, on, state } from "../core/state.js";
import { forgetEye, hasEye, keepLook, placeEye } from "../view/link.js";
import { drawTools, toggle } from "../view/tools.js";
import { currentStage, lookAt, setLook, show } from "../view/view.js";
import { AlignSection } from "./align.js";
import { copyLink, saveBounds, saveDistances, savePicture } from "./exports.js";
import { limitOf, makeForm, readRequest, readSettings, settings } from "./form.js";
import { ComparisonSection } from "./comparison.js";
import { DeviationMap } from "./map.js";
import { Measurement } from "./measurement.js";
import { makeOutcome } from "./outcome.js";
import { readWanted } from "./range.js";
import { Section } from "./section.js";
import { aFirst } from "./witness.js";

/** @import { Transform } from "../../js/types.js" */
/** @import { Role, Wish } from "../view/stage.js" */

/** What a link says of another pair, or of A elsewhere. */
const NOTHING_MEASURED = { heat: null, accuracy: null, back: null, region: null, pins: null, comparison: null, place: null, alignment: null };

/** @param {HTMLElement} panel */
export function showCompare(panel) {
  const page = new Compare(panel);
  return () => page.leave();
}

class Compare {
  /** @param {HTMLElement} panel */
  constructor(panel) {
    readSettings();
    readWanted();
    setPoseParameter();
    const hidden = (parameter("hide") ?? "").split("");
    this.shown = { a: !hidden.includes("a"), b: !hidden.includes("b") };
    /** Was the view led to the farthest points yet? */
    this.isFollowed = false;
    /** One of the worst places, in the place of the farthest points. @type {{ from: number[], to: number[] } | null} */
    this.place = null;
    this.pairKey = "";
    this.view = "nothing yet";
    this.pair = "";
    this.isWaiting = false;
    setLook({ structure: false });
    this.stopLook = keepLook();
    this.measurement = new Measurement(() => this.requestDraw());
    this.outcome = makeOutcome();
    this.form = makeForm({ onMeasure: () => this.measure(), onStop: () => run(() => this.measurement.stop()), onInput: () => this.requestDraw(), onReading: () => this.onReading(), onSwap: () => swap() });
    this.map = new DeviationMap({
      quads: () => /** @type {any} */ (settings.quads), limit: () => limitOf(settings),
      onChange: () => this.requestDraw(), onMeasured: () => this.clearForMap() });
    this.comparison = new ComparisonSection({
      quads: () => /** @type {any} */ (settings.quads), limit: () => limitOf(settings), sign: this.map.sign, onChosen: (points) => this.showPlace(points) });
    this.alignment = new AlignSection({
      quads: () => /** @type {any} */ (settings.quads), limit: () => limitOf(settings), onPose: (transform) => this.move(transform), onTurn: (turn) => this.showTurn(turn) });
    this.section = new Section();
    this.fly = h("button", { type: "button", disabled: true, onclick: () => run(() => this.flyToPair()) }, "Show the farthest points");
    this.csv = h("button", { type: "button", disabled: true, onclick: () => saveBounds(this.measurement) }, "Bounds, CSV");
    this.distancesCsv = h("button", { type: "button", disabled: true, onclick: () => saveDistances(this.map.heat) }, "Distances, CSV");
    this.fill(panel);
    this.openJob(parameter("job"));
    this.onChoice();
    const redraw = () => { this.draw(); this.map.draw(); };
    this.sizes = new ResizeObserver(redraw);
    this.sizes.observe(panel);
    this.off = [on(["meshes", "choice"], () => this.onChoice()), on("theme", redraw)];
  }

  /** @param {HTMLElement} panel */
  fill(panel) {
    panel.append(
      h("section", { className: "section", "aria-labelledby": "compare-title" }, h("header", {}, h("h2", { id: "compare-title" }, "Compare")), this.form.form),
      h("section", { className: "section", "aria-labelledby": "distance-title" },
        h("header", {}, h("h2", { id: "distance-title" }, "Hausdorff distance"), this.fly), this.outcome.element),
      this.map.element, this.comparison.element, this.alignment.element,
      h("section", { className: "section", "aria-labelledby": "export-title" },
        h("h2", { id: "export-title" }, "Export"),
        h("div", { className: "row" }, h("button", { type: "button", onclick: () => run(copyLink) }, "Copy link"),
          h("button", { type: "button", onclick: () => run(() => savePicture(this.map, this.comparison.labels)) }, "Picture, PNG"), this.csv, this.distancesCsv)));
  }

  /** Events may come faster than the screen shows them. */
  requestDraw() {
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWaiting = false;
      this.draw();
    });
  }

  draw() {
    const { measurement, map } = this;
    this.form.draw(measurement.isRunning);
    const request = measurement.job?.request;
    this.outcome.draw(measurement, request?.limit ?? limitOf(settings));
    this.csv.disabled = measurement.samples.length === 0;
    this.distancesCsv.disabled = !map.deviation?.distances.length;
    map.button.disabled = state.a === null || state.b === null || map.search.isRunning;
    map.sign.draw(map.heat.hasSides);
    this.alignment.draw();
    this.comparison.button.disabled = map.button.disabled || this.comparison.search.isRunning;
    this.showPair();
  }

  /** The farthest points of what is shown, that on A before that on B. */
  get witness() {
    const { job, result } = this.measurement;
    if (!result?.witness || !isMoved(job?.request.a) || job?.request.b !== state.b) return null;
    const [from, to] = aFirst(result.witness);
    return { from, to };
  }

  showPair() {
    const { witness } = this;
    const points = this.place ?? witness;
    const stage = currentStage();
    this.fly.disabled = !witness || !stage;
    const key = stage ? JSON.stringify([points, stage.frame]) : "";
    if (key !== this.pairKey) stage?.setPair(points);
    this.pairKey = key;
    if (!witness || this.isFollowed || !stage?.models.get("a")?.isWhole) return;
    this.isFollowed = true;
    if (!hasEye()) run(() => this.flyToPair());
  }

  /** A place of the comparison, which takes the place of the farthest points. @param {{ from: number[], to: number[] }} points */
  showPlace(points) {
    this.place = points;
    this.showPair();
  }

  async flyToPair() {
    this.place = null;
    this.showPair();
    if (this.witness) await lookAt([this.witness.from, this.witness.to], "the farthest points");
  }

  async drawView() {
    const { shown } = this;
    /** @type {Wish[]} */
    const wishes = [];
    const isBilinear = settings.quads === "bilinear";
    for (const role of /** @type {const} */ (["a", "b"])) {
      const mesh = meshOf(state[role]);
      if (mesh) wishes.push({ mesh, role, isBilinear, isHidden: !shown[role], isGhost: role === "b" && shown.a, transform: role === "a" ? poseOfA() : null });
    }
    setParameters({ hide: ["a", "b"].filter((role) => !shown[/** @type {Role} */ (role)]).join("") });
    const key = wishes.map((wish) => `${wish.role} ${wish.mesh.id} ${wish.mesh.revision} ${isBilinear} ${wish.isHidden} ${wish.isGhost} ${wish.transform}`).join();
    if (key === this.view) return;
    this.view = key;
    drawTools(wishes.map(({ mesh }) => mesh), { more: [
      toggle("A", "Show A", shown.a, (isOn) => { shown.a = isOn; this.drawView(); }),
      toggle("B", "Show B", shown.b, (isOn) => { shown.b = isOn; this.drawView(); }), ...this.section.tools] });
    if (await show(wishes, "Choose two meshes to compare.")) this.onWhole();
  }

  /** What is to be shown has come. */
  onWhole() {
    placeEye();
    this.showPair();
    run(() => this.section.draw());
    if (this.map.deviation) run(() => this.map.paint());
    else run(() => this.map.restore());
    run(() => this.alignment.restore());
    run(() => (this.comparison.found ? this.comparison.pin() : this.comparison.restore()));
  }

  measure() {
    this.isFollowed = false;
    forgetEye();
    setParameters({ a: state.a, b: state.b, job: null });
    this.measurement.ask(readRequest()).then(() => setParameters({ job: this.measurement.job?.id }));
  }

  /** A ghost of B would dull the colours. */
  clearForMap() {
    if (this.shown.a && !hasEye()) this.shown.b = false;
    this.drawView();
  }

  onReading() {
    this.forget();
    this.drawView();
  }

  /** What was measured holds no more. */
  forget() {
    this.place = null;
    this.map.forget();
    this.comparison.leave();
    this.alignment.forget();
  }

  /** Moves A; null: to where it lies. @param {Transform | null} transform */
  move(transform) {
    this.forget();
    this.measurement.clear();
    keepPose(transform);
    setPoseParameter();
    forgetEye();
    setParameters({ ...NOTHING_MEASURED, job: null });
    this.drawView();
    this.draw();
  }

  /** Shows A or B alone, a place of which is to be clicked; null: both. @param {Role | null} turn */
  showTurn(turn) {
    this.shown = { a: turn !== "b", b: turn !== "a" };
    this.drawView().then(() => { if (turn) currentStage()?.fit(); });
  }

  onChoice() {
    const pair = `${state.a} ${state.b}`;
    if (pair !== this.pair) {
      if (this.pair !== "") {
        forgetEye();
        setParameters({ a: state.a, b: state.b, ...NOTHING_MEASURED });
        keepPose(null);
        setPoseParameter();
      }
      this.pair = pair;
      this.forget();
    }
    this.drawView();
    this.draw();
  }

  /** The job of a link. @param {string | null} id */
  openJob(id) {
    if (!id) return;
    this.isFollowed = hasEye();
    this.measurement.open(id).then((opened) => {
      if (!opened || opened.type !== "hausdorff") return;
      this.form.fill(opened.request);
      const { a, b } = opened.request;
      [state.a, state.b] = [a.mesh ?? a, b];
      this.onChoice();
      if (isMoved(a)) return;
      keepPose(a.transform ?? null);
      setPoseParameter();
      this.onReading();
    });
  }

  leave() {
    this.off.forEach((off) => off());
    this.sizes.disconnect();
    this.stopLook();
    this.measurement.leave();
    this.forget();
    this.section.leave();
    setLook({ through: false });
    currentStage()?.setPair(null);
  }
}

/** A becomes B, and B becomes A. */
function swap() {
  [state.a, state.b] = [state.b, state.a];
  setParameters({ a: state.a, b: state.b, job: null });
  changed("choice");
}
