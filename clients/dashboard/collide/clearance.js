// How far apart A and B are, with the place, and whether that is as much as is wanted.

import { figures, h } from "../core/dom.js";
import { length } from "../core/format.js";
import { run } from "../core/messages.js";
import { Search } from "../core/search.js";
import { currentStage, lookAt } from "../view/view.js";

/** @import { DistanceResult, MeshName, QuadReading } from "../../js/types.js" */

const DIGITS = 7;

export class Clearance {
  /** @param {{ quads: () => QuadReading }} options */
  constructor({ quads }) {
    this.quads = quads;
    this.searching = new Search();
    /** @type {DistanceResult | null} */
    this.result = null;
    this.verdict = h("p", { className: "verdict", id: "clearance", role: "status", hidden: true });
    this.figures = h("div");
    this.fly = h("button", { type: "button", onclick: () => run(() => this.look()) }, "Show the nearest points");
    this.element = h("section", { className: "section", "aria-labelledby": "clearance-title", hidden: true },
      h("header", {}, h("h2", { id: "clearance-title" }, "Clearance"), this.fly), this.searching.element, this.verdict, this.figures);
  }

  /**
   * The verdict first, which is certain before the distance is.
   * @param {MeshName} a
   * @param {string} b
   * @param {number | null} limit
   * @param {boolean} isFlight are the nearest points to be looked at?
   */
  async search(a, b, limit, isFlight) {
    this.forget();
    this.element.hidden = false;
    const question = { type: /** @type {const} */ ("distance"), a, b, quads: this.quads() };
    if (limit !== null) this.drawVerdict(/** @type {DistanceResult} */ ((await this.searching.run({ ...question, limit })).result), limit);
    this.result = /** @type {DistanceResult} */ ((await this.searching.run(question)).result);
    const { lower, upper } = this.result;
    this.figures.replaceChildren(figures([["Least distance", `${length(lower, DIGITS)} to ${length(upper, DIGITS)}`]], "figures single"));
    this.fly.disabled = false;
    this.mark();
    if (isFlight) await this.look();
  }

  /** @param {DistanceResult} result @param {number} limit */
  drawVerdict({ verdict }, limit) {
    this.verdict.hidden = false;
    this.verdict.className = `verdict${verdict === null ? "" : verdict === "above" ? " good" : " fault"}`;
    this.verdict.textContent = verdict === null ? `It is not certain on which side of ${limit} the clearance is.`
      : verdict === "above" ? `The clearance is above the ${limit} wanted.` : `The clearance is not above the ${limit} wanted.`;
  }

  get points() {
    const { from, to } = /** @type {DistanceResult} */ (this.result).witness;
    return { from: from.point, to: to.point };
  }

  /** Draws the nearest points. */
  mark() {
    if (this.result) currentStage()?.setPair(this.points);
  }

  async look() {
    if (!this.result) return;
    this.mark();
    await lookAt([this.points.from, this.points.to], "the nearest points");
  }

  forget() {
    this.searching.leave();
    this.result = null;
    this.element.hidden = this.verdict.hidden = this.fly.disabled = true;
    this.figures.replaceChildren();
    currentStage()?.setPair(null);
  }
}
