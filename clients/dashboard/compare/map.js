// The section of the deviation: asks for it, shows figures and histogram, colours A, answers what is pointed at.

import { h } from "../core/dom.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { Search, describeMaximum } from "../core/search.js";
import { meshOf, nameOf, state } from "../core/state.js";
import { currentStage } from "../view/view.js";
import { bandsOf } from "./bands.js";
import { FIRST_ACCURACY, drawDeviation, drawHistogram, makeHistogram, measureDeviation } from "./deviation.js";
import { Heat } from "./heat.js";
import { moved } from "../core/pose.js";
import { makeRange, wanted } from "./range.js";
import { Regions } from "./regions.js";
import { SignChoice } from "./sign.js";

/** @import { MeshName, QuadReading } from "../../js/types.js" */
/** @import { Deviation } from "./deviation.js" */
/** @import { Probe } from "./probe.js" */

/** How much finer "More exactly" asks each time, down to what, and with how many pieces. */
const FINER = 4;
const FINEST = FIRST_ACCURACY / FINER ** 3;
const MORE_PIECES = 4194304;

export class DeviationMap {
  /**
   * @param {object} options
   * @param {() => QuadReading} options.quads the reading of quads
   * @param {() => number | null} options.limit the permitted distance, null for none
   * @param {() => void} options.onChange
   * @param {() => void} options.onMeasured before A is coloured
   */
  constructor({ quads, limit, onChange, onMeasured }) {
    this.quads = quads;
    this.limit = limit;
    this.onChange = onChange;
    this.onMeasured = onMeasured;
    this.heat = new Heat(wanted);
    this.sign = new SignChoice(() => run(() => this.setSign()));
    this.regions = new Regions();
    this.search = new Search(describeMaximum);
    /** The other way round. @type {Deviation | null} */
    this.back = null;
    /** @type {Probe | null} */
    this.probe = null;
    /** Of what the parts beyond the limit are listed. @type {Deviation | null} */
    this.listed = null;
    /** The limits whose bands were asked for. @type {[number, number] | null} */
    this.askedLimits = null;
    this.accuracy = FIRST_ACCURACY;
    this.button = h("button", { type: "button", onclick: () => run(() => this.measure()) }, "Map the distances");
    this.more = h("button", { type: "button", title: "Search for tighter figures", onclick: () => run(() => this.measure(this.accuracy / FINER)) }, "More exactly");
    this.other = h("button", { type: "button", title: "Measure how far B lies from A, too", onclick: () => run(() => this.measureBack()) }, "B from A, too");
    this.pin = h("button", { type: "button", title: "Pin the distance of what is in the middle of the view", onclick: () => run(() => this.pinMiddle()) }, "Value in the middle");
    this.range = makeRange({ onChange: () => this.rescale(), firstLimit: limit });
    this.histogram = makeHistogram();
    this.figures = h("div");
    this.words = h("p", { className: "muted" });
    this.found = h("div", { className: "section", hidden: true }, h("div", { className: "row" }, this.sign.button, this.sign.normals, this.other, this.more, this.pin),
      this.sign.reason, this.range.element, this.regions.element, this.histogram, this.figures);
    this.element = h("section", { className: "section", "aria-labelledby": "deviation-title" },
      h("header", {}, h("h2", { id: "deviation-title" }, "Deviation of A from B"), this.button), this.words, this.search.element, this.found);
    this.forget();
  }

  get deviation() {
    return this.heat.deviation;
  }

  get names() {
    return { a: nameOf(state.a), b: nameOf(state.b) };
  }

  /** @param {MeshName} a @param {MeshName} b */
  question(a, b) {
    return { a, b, quads: this.quads(), ...(this.accuracy < FIRST_ACCURACY ? { accuracy: this.accuracy, engine: { pieces: MORE_PIECES } } : {}) };
  }

  /** What is asked of A from B alone: its sides, and its parts beyond the limit. */
  extras() {
    const limit = this.limit();
    return { ...bandsOf(this.sign.sign), ...(limit === null ? {} : { limit, regions: meshOf(state.a)?.kind !== "points" }) };
  }

  async measure(accuracy = FIRST_ACCURACY) {
    if (state.a === null || state.b === null) return;
    this.accuracy = accuracy;
    this.words.textContent = "";
    try {
      const deviation = await this.ask(moved(), state.b);
      const isFirst = this.deviation === null;
      this.heat.take(deviation);
      this.draw();
      setParameters({ heat: 1, accuracy: accuracy < FIRST_ACCURACY ? accuracy : null });
      if (isFirst) this.onMeasured();
      await this.paint();
    } catch (error) {
      this.explain();
      sayFault(error);
    } finally {
      this.onChange();
    }
  }

  /** The map of a link. */
  async restore() {
    if (!parameter("heat") || this.search.isRunning) return;
    const isTwoSided = parameter("back") !== null;
    await this.measure(Math.max(FINEST, Math.min(FIRST_ACCURACY, Number(parameter("accuracy")) || FIRST_ACCURACY)));
    if (isTwoSided && this.deviation && !this.back) await this.measureBack();
  }

  /** @param {MeshName} a @param {MeshName} b */
  ask(a, b) {
    return this.sign.ask(() => {
      this.askedLimits = wanted.limits;
      return measureDeviation(this.search, { ...this.question(a, b), ...this.extras() });
    });
  }

  /** B from A, beside A from B. */
  async measureBack() {
    const { deviation } = this;
    const back = await measureDeviation(this.search, this.question(/** @type {string} */ (state.b), moved()));
    if (deviation !== this.deviation) return;
    this.back = back;
    setParameters({ back: 1 });
    this.draw();
  }

  /** Colours A, as soon as it is there, and lets it be probed. */
  async paint() {
    const { deviation } = this;
    if (!deviation) return;
    this.words.textContent = "Colouring A";
    await this.heat.paint(this.names).finally(() => this.explain());
    if (deviation !== this.deviation || !this.heat.painted) return;
    this.draw();
    await Promise.all([this.takeProbe(), this.regions.paint()]);
    this.onChange();
  }

  async takeProbe() {
    const stage = currentStage();
    if (!stage || meshOf(state.a)?.kind === "points" || (this.probe && this.probed === this.heat.painted?.model)) return;
    const { Probe } = await import("./probe.js");
    if (!this.heat.painted) return;
    this.probe?.dispose();
    this.probe = new Probe(stage, {
      quads: /** @type {any} */ (this.deviation?.result.quads), telling: () => this.heat.telling, onPins: () => setParameters({ pins: this.probe?.toText() || null }) });
    this.probed = this.heat.painted?.model;
    await this.probe.restore(parameter("pins"));
  }

  async pinMiddle() {
    const stage = currentStage();
    if (!stage || !this.probe) return;
    const before = this.probe.pins.length;
    await this.probe.pinAt(stage.canvas.clientWidth / 2, stage.canvas.clientHeight / 2);
    if (this.probe.pins.length === before) throw new Error("There is no surface in the middle of the view.");
  }

  /** Another sign is wanted. */
  async setSign() {
    await this.measure(this.accuracy);
    await this.probe?.again();
  }

  /** The range or the limits are others: at once, and finer if it wants that; the daemon has the shares of other bands. */
  rescale() {
    this.heat.show(this.names);
    this.draw();
    if (this.deviation?.result.signed && wanted.limits && `${wanted.limits}` !== `${this.askedLimits}`) run(() => this.measure(this.accuracy));
    else run(() => this.heat.paint(this.names));
  }

  draw() {
    const { deviation, scale } = this.heat;
    this.found.hidden = !deviation;
    this.sign.draw(this.heat.hasSides);
    if (!deviation || !scale) return;
    this.figures.replaceChildren(drawDeviation(deviation, this.back, this.names));
    this.more.disabled = deviation.result.accuracy <= FINEST;
    this.other.disabled = this.back !== null;
    this.range.draw(scale, deviation);
    drawHistogram(this.histogram, deviation.result, scale);
    if (this.listed === deviation) return;
    this.listed = deviation; // who looks at one of the places goes on doing so
    this.regions.draw(deviation.result, this.limit());
  }

  explain() {
    this.words.textContent = this.deviation ? "" : "How far each part of A lies from B: colours on A, a histogram and percentiles.";
  }

  /** The meshes are others now. */
  forget() {
    this.search.leave();
    this.heat.forget();
    this.sign.forget();
    this.regions.forget();
    this.probe?.dispose();
    this.back = this.probe = null;
    this.explain();
    this.draw();
  }
}
