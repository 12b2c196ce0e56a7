// The section of the comparison: the figures of both directions and of both together, the worst places, and a report to hand on.

import { client } from "../core/connection.js";
import { colour, download, h } from "../core/dom.js";
import { ENOUGH, intervals, shareBetween } from "../core/format.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { Search, describeMaximum } from "../core/search.js";
import { meshOf, state } from "../core/state.js";
import { makeTable, writeRows } from "../core/table.js";
import { makePlaces } from "../view/places.js";
import { currentStage, lookAt } from "../view/view.js";
import { bandRows, bandsOf } from "./bands.js";
import { moved } from "../core/pose.js";
import { wanted } from "./range.js";
import { aFirst } from "./witness.js";

/** @import { ComparisonResult, LengthInterval, QuadReading, Witness } from "../../js/types.js" */
/** @import { Labels } from "../view/labels.js" */
/** @import { SignChoice } from "./sign.js" */
/** @typedef {LengthInterval & Witness & { side: "A" | "B" }} WorstPlace */

const WORST_COUNT = 5;
/** Why B has no sides against A. */
const UNSIGNED = { empty: "A has no faces", open: "A is open", turned: "faces of A are turned against one another", crossing: "A meets itself",
  canceled: "it was stopped before that was known" };
/** Of the diagonal. */
const RADIUS_SHARE = 0.05;

export class ComparisonSection {
  /**
   * @param {object} options
   * @param {() => QuadReading} options.quads
   * @param {() => number | null} options.limit the permitted distance
   * @param {SignChoice} options.sign whether and how sides are told
   * @param {(points: { from: number[], to: number[] }) => void} options.onChosen a place is looked at
   */
  constructor({ quads, limit, sign, onChosen }) {
    this.quads = quads;
    this.limit = limit;
    this.sign = sign;
    this.onChosen = onChosen;
    this.search = new Search(describeMaximum);
    /** @type {{ id: string, result: ComparisonResult, places: WorstPlace[] } | null} */
    this.found = null;
    /** @type {Labels | null} */
    this.labels = null;
    this.button = h("button", { type: "button", onclick: () => run(() => this.measure()) }, "Compare both ways");
    this.report = h("button", { type: "button", onclick: () => run(() => this.saveReport()) }, "Report, HTML");
    this.words = h("p", { className: "muted" });
    this.figures = h("div", { className: "section" });
    this.element = h("section", { className: "section", "aria-labelledby": "comparison-title" },
      h("header", {}, h("h2", { id: "comparison-title" }, "Both ways, and the worst places"), this.button), this.words, this.search.element, this.figures);
    this.forget();
  }

  /** How far apart the worst places are at least. */
  get radius() {
    return RADIUS_SHARE * (meshOf(state.a)?.bounding_box.diagonal ?? 0);
  }

  /** The place of a link. */
  get chosen() {
    return Number(parameter("place") ?? 0) - 1;
  }

  /** @param {string} b */
  question(b) {
    const limits = [this.limit(), wanted.limits?.[1] ?? null].filter((limit) => limit !== null && limit >= 0);
    return { type: /** @type {const} */ ("comparison"), a: moved(), b, quads: this.quads(), worst: { count: WORST_COUNT, radius: this.radius },
      limits: /** @type {number[]} */ ([...new Set(limits)]), ...bandsOf(this.sign.sign) };
  }

  async measure() {
    const { b } = state;
    setParameters({ place: null });
    if (state.a !== null && b !== null) await this.take(this.sign.ask(() => this.search.run(this.question(b))));
  }

  /** The comparison of a link. */
  async restore() {
    const id = parameter("comparison");
    if (id && !this.found && !this.search.isRunning) await this.take(this.search.open(id));
  }

  /** @param {Promise<import("../core/search.js").Found>} asked */
  async take(asked) {
    this.forget();
    this.words.textContent = "";
    try {
      const { id, result: answer } = await asked;
      const result = /** @type {ComparisonResult} */ (answer);
      this.found = { id, result, places: worstOf(result, this.radius) };
      setParameters({ comparison: id });
      this.draw();
      if (this.chosen >= 0) this.choose(this.chosen);
      await this.pin();
    } catch (error) {
      this.explain();
      sayFault(error);
    }
  }

  draw() {
    if (!this.found) return;
    const { result, places } = this.found;
    const written = intervals(places, ENOUGH);
    this.figures.replaceChildren(drawFigures(result), makePlaces("Worst places", places.map(({ side, from, to }, place) => ({
      words: `${place + 1}: ${written[place]}, on ${side}`,
      points: aFirst({ from, to }), what: `place ${place + 1}` })), (place) => this.choose(place), this.chosen), h("div", { className: "row" }, this.report));
  }

  /** Numbers at the worst places. */
  async pin() {
    const { found } = this;
    const stage = currentStage();
    if (!found || !stage) return;
    const { Labels } = await import("../view/labels.js");
    if (found !== this.found) return;
    this.labels?.dispose(); // also those of a call that came first in the meantime
    const labels = this.labels = new Labels(stage);
    found.places.forEach(({ side, from }, place) => {
      const pin = h("button", { type: "button", title: `The worst place ${place + 1}, on ${side}`, onclick: () => this.flyTo(place) }, String(place + 1));
      pin.style.borderColor = colour(side === "A" ? "--mesh-a" : "--mesh-b");
      labels.add(from.point, pin);
    });
  }

  /** @param {number} place */
  flyTo(place) {
    this.choose(place);
    const { from, to } = /** @type {NonNullable<typeof this.found>} */ (this.found).places[place];
    run(() => lookAt(aFirst({ from, to }), `place ${place + 1}`));
  }

  /** @param {number} place */
  choose(place) {
    const chosen = this.found?.places[place];
    if (!chosen) return;
    setParameters({ place: place + 1 });
    this.onChosen({ from: chosen.from.point, to: chosen.to.point });
  }

  /** The comparison as a page to hand on. */
  async saveReport() {
    if (!this.found) return;
    const html = await client.jobs.report(this.found.id, { limit: this.limit() ?? undefined });
    download(new Blob([html], { type: "text/html" }), "report.html");
  }

  explain() {
    this.words.textContent = "Figures of A from B, of B from A, and of both together; where they are farthest apart; a report to hand on.";
  }

  /** The meshes are others now. */
  forget() {
    this.labels?.dispose();
    this.labels = this.found = null;
    this.figures.replaceChildren();
    this.explain();
  }

  leave() {
    this.search.leave();
    this.forget();
  }
}

/**
 * Of both directions, the farthest first. The two are often farthest apart at places that lie side by side: the lesser of them is left out.
 * @param {ComparisonResult} result
 * @param {number} radius about which places count as one
 * @returns {WorstPlace[]}
 */
function worstOf({ a_to_b: there, b_to_a: back }, radius) {
  /** @type {WorstPlace[]} */
  const all = [...(there.worst ?? []).map((place) => ({ ...place, side: /** @type {const} */ ("A") })),
    ...(back.worst ?? []).map((place) => ({ ...place, side: /** @type {const} */ ("B") }))].sort((one, other) => other.lower - one.lower);
  return all.reduce((kept, place) => (kept.some((before) => isBeside(before, place, radius)) ? kept : [...kept, place]), /** @type {WorstPlace[]} */ ([]));
}

/** Are two places of the two meshes one, as both are ends of nearly the same way? @param {WorstPlace} one @param {WorstPlace} other @param {number} radius */
function isBeside(one, other, radius) {
  const isNear = (/** @type {number[]} */ p, /** @type {number[]} */ q) => Math.hypot(...p.map((x, k) => x - q[k])) < radius;
  return one.side !== other.side && (isNear(one.from.point, other.from.point) || isNear(one.from.point, other.to.point) || isNear(one.to.point, other.from.point));
}

/** @param {ComparisonResult} result */
function drawFigures({ a_to_b: there, b_to_a: back, symmetric: both, accurate }) {
  const of95 = (/** @type {typeof there} */ { percentiles }) => percentiles.find((one) => one.percent === 95) ?? null;
  const rows = writeRows([
    ["Maximum", [both.hausdorff, there.hausdorff, back.hausdorff]], ["95 % lie within", [both.hd95, of95(there), of95(back)]],
    ["Mean", [both.mean, there.mean, back.mean]], ["RMS", [both.rms, there.rms, back.rms]],
    ["Standard dev.", [null, there.std, back.std]], ["Chamfer, sum", [both.chamfer.l1, null, null]]], ENOUGH);
  const shares = there.shares.map(({ limit, ...share }, place) => /** @type {[string, string[]]} */ ([`Share within ${limit}`,
    ["", shareBetween(share), shareBetween(back.shares[place])]]));
  const scores = both.f_score.map(({ limit, f }) => /** @type {[string, string[]]} */ ([`F-score at ${limit}`, [shareBetween(f), "", ""]]));
  const bands = bandRows([there.signed, back.signed]).map(([name, cells]) => /** @type {[string, string[]]} */ ([name, ["", ...cells]]));
  const signed = there.signed && writeRows([["Signed mean", [null, there.signed.mean, back.signed?.mean ?? null]]], ENOUGH);
  return h("div", { className: "section", id: "comparison" },
    makeTable("Figures of both directions", ["Both", "A from B", "B from A"], [...rows, ...signed ?? [], ...shares, ...bands, ...scores]),
    there.signed && h("p", { className: "muted small" }, there.signed.proven ? "The sides are proven." : "The sides are those of the normals of the nearest faces: not proven.",
      back.unsigned ? ` B has no sides against A: ${UNSIGNED[back.unsigned]}.` : ""),
    h("p", { className: "muted small" }, `Each figure is proven, with ± what is not known of it.${accurate ? "" : " It ended before they were as narrow as wanted."}`));
}
