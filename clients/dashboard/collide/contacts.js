// The pairs of faces that meet: how many, each to be stepped to, with what it is and the normals of its faces.

import { client } from "../core/connection.js";
import { figures, h } from "../core/dom.js";
import { count, duration } from "../core/format.js";
import { run } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { Search } from "../core/search.js";
import { currentStage, lookAt } from "../view/view.js";

/** @import { CollisionPair, CollisionResult, MeshName, Point, QuadReading } from "../../js/types.js" */

/** Pairs that can be stepped to. */
const MOST_LISTED = 10000;
const NORMAL_DIGITS = 4;

export class Contacts {
  /** @param {{ quads: () => QuadReading }} options */
  constructor({ quads }) {
    this.quads = quads;
    this.searching = new Search();
    /** @type {{ result: CollisionResult, pairs: Float64Array, isSelf: boolean } | null} */
    this.found = null;
    this.place = 0;
    this.outcome = h("p", { className: "outcome muted", id: "collisions", role: "status" });
    this.where = h("output", { className: "number", id: "contact" });
    this.normals = h("div", { id: "normals" });
    this.details = h("div", { className: "section" });
    this.element = h("div", { className: "section" }, this.outcome, this.searching.element, this.details);
    this.forget();
  }

  /**
   * @param {MeshName} a
   * @param {string | null} b null: A itself
   * @param {boolean} isFlight are the contacts to be looked at?
   * @returns {Promise<CollisionResult | null>} null when something else was asked for meanwhile
   */
  async search(a, b, isFlight) {
    this.forget();
    this.outcome.textContent = "";
    const common = { quads: this.quads(), limit: MOST_LISTED };
    const { id, result: answer, isStopped } = await this.searching.run(b === null ? { type: "self_collision", mesh: a, ...common } : { type: "collision", a, b, ...common });
    const result = /** @type {CollisionResult} */ (answer);
    const { signal } = this.searching.reader;
    const pairs = await client.jobs.pairs(id);
    if (signal.aborted) return null;
    this.found = { result, pairs, isSelf: b === null };
    this.place = 0;
    this.outcome.textContent = isStopped ? `Stopped: ${meeting(result.count)} so far` : result.collides ? meeting(result.count)
      : b === null ? "No faces meet that should not" : "The two do not meet";
    this.details.replaceChildren(...(result.collides ? [this.stepper(result), this.normals] : []),
      figures([["Search", duration(result.elapsed_ms)], ["Exact tests", count(result.tests)]]));
    await this.step(Number(parameter("contact") ?? 1) - 1, isFlight);
    return result;
  }

  /** @param {CollisionResult} result */
  stepper({ count: all, pairs }) {
    const button = (/** @type {string} */ words, /** @type {string} */ label, /** @type {number} */ by) => h("button", {
      type: "button", "aria-label": label, onclick: () => run(() => this.step(this.place + by)) }, words);
    const left = all > pairs.length && h("span", { className: "muted small" }, `The first ${count(pairs.length)} of ${count(all)} can be stepped through.`);
    return h("div", { className: "row", role: "group", "aria-label": "Contacts" }, button("◀", "Previous contact", -1), this.where, button("▶", "Next contact", 1), left);
  }

  /** @param {number} place @param {boolean} [isFlight] is it to be looked at? */
  async step(place, isFlight = true) {
    const pairs = this.found?.result.pairs ?? [];
    if (pairs.length === 0) return;
    this.place = (((Math.floor(place) || 0) % pairs.length) + pairs.length) % pairs.length;
    const pair = pairs[this.place];
    this.where.textContent = `${count(this.place + 1)} of ${count(pairs.length)}: faces ${pair.faces[0]} and ${pair.faces[1]}, ${article(pair.contact)}`;
    this.normals.replaceChildren(figures(rowsOf(pair, Boolean(this.found?.isSelf)), "figures single"));
    setParameters({ contact: this.place + 1 });
    await this.paint();
    if (isFlight) await lookAt(pair.points, "the contact", 0.35);
  }

  /** Draws what was found over the meshes. */
  async paint() {
    const stage = currentStage();
    const { found } = this;
    if (!stage || !found) return;
    const { drawContacts } = await import("./drawing.js");
    if (found === this.found) await drawContacts(stage, { ...found, current: found.result.pairs[this.place] ?? null });
  }

  forget() {
    this.searching.leave();
    this.found = null;
    this.outcome.textContent = "";
    this.details.replaceChildren(h("p", { className: "muted" }, "Faces that have a point in common: of A and B, or of A alone when B is A itself."));
    currentStage()?.setOverlay();
  }
}

/** @param {CollisionPair} pair @param {boolean} isSelf @returns {[string, string][]} */
function rowsOf({ faces, normals: [one, other] }, isSelf) {
  const names = isSelf ? [`face ${faces[0]}`, `face ${faces[1]}`] : ["A's face", "B's face"];
  const cosine = one.reduce((sum, x, k) => sum + x * other[k], 0);
  const hasBoth = [one, other].every((normal) => normal.some((x) => x !== 0));
  return [[`Normal of ${names[0]}`, writeNormal(one)], [`Normal of ${names[1]}`, writeNormal(other)],
    ["Angle of the normals", hasBoth ? `${((Math.acos(Math.max(-1, Math.min(1, cosine))) * 180) / Math.PI).toFixed(1)}°` : "–"]];
}

/** @param {Point} normal */
const writeNormal = (normal) => (normal.every((x) => x === 0) ? "none: it has no area" : normal.map((x) => String(Number(x.toFixed(NORMAL_DIGITS)))).join(", "));

/** @param {number} number of pairs */
const meeting = (number) => `${count(number)} pair${number === 1 ? "" : "s"} of faces meet`;

/** @param {string} contact */
const article = (contact) => `${contact === "area" ? "an" : "a"} ${contact}`;
