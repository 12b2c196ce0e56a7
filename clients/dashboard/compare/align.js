// The section of the alignment: moves A onto B, by itself or by landmarks, and tells how well it fits.

import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { figures, h, select } from "../core/dom.js";
import { ENOUGH, intervals, length } from "../core/format.js";
import { run, say } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { Search } from "../core/search.js";
import { changed, meshOf, nameOf, state } from "../core/state.js";
import { toggle } from "../view/tools.js";
import { currentStage } from "../view/view.js";
import { multiply } from "../view/transform.js";
import { moved, poseOfA } from "../core/pose.js";

/** @import { AlignmentRequest, AlignmentResult, Job, QuadReading, Transform } from "../../js/types.js" */
/** @import { Role } from "../view/stage.js" */
/** @import { Landmarks } from "./landmarks.js" */

const LEAST_PAIRS = 3;
const DIGITS = 4;
const MOST_TRIM = 90;
/** A runner-up whose RMS is no greater than this times the best one fits about as well. */
const ALIKE = 1.25;
/** Of A's diagonal: below this both are exact fits. */
const ALIKE_SHARE = 1e-9;

export class AlignSection {
  /**
   * @param {object} options
   * @param {() => QuadReading} options.quads
   * @param {() => number | null} options.limit the permitted distance
   * @param {(transform: Transform | null) => void} options.onPose A is to be moved; null: to where it lies
   * @param {(turn: Role | null) => void} options.onTurn a place of A or B is to be clicked; null: no more
   */
  constructor({ quads, limit, onPose, onTurn }) {
    this.quads = quads;
    this.limit = limit;
    this.onPose = onPose;
    this.onTurn = onTurn;
    this.search = new Search(() => "");
    /** @type {AlignmentResult | null} */
    this.result = null;
    /** @type {Landmarks | null} */
    this.landmarks = null;
    const button = (/** @type {string} */ words, /** @type {() => Promise<unknown>} */ action) => h("button", { type: "button", onclick: () => run(action) }, words);
    this.button = button("Align A onto B", () => this.align());
    this.fit = select("fit", [["least_squares", "least squares"], ["min_max", "least maximum"]], "least_squares");
    this.motion = select("motion", [["rigid", "turn and shift"], ["rigid_scale", "turn, shift and scale"], ["translation", "shift alone"]], "rigid");
    this.start = select("start", [["principal", "all turns of the axes"], ["centroids", "the centroids, not turned"], ["identity", "where A lies"]], "principal");
    this.trim = h("input", { name: "trim", type: "number", min: "0", max: String(MOST_TRIM), step: "any", value: "0" });
    this.mirror = h("input", { name: "mirror", type: "checkbox" });
    this.fit.addEventListener("change", () => this.draw());
    this.picker = toggle("By landmarks", "Click pairs of places that belong together", false, (isOn) => run(async () => (isOn ? this.pick() : this.endPick())));
    this.byPairs = button("Align by these", () => this.align(this.landmarks?.pairs));
    this.middle = button("Take the middle of the view", async () => this.landmarks?.takeMiddle());
    this.last = button("Take the last back", async () => this.landmarks?.takeBack());
    this.turn = h("p", { id: "landmarks", role: "status" });
    this.picking = h("div", { className: "section", hidden: true }, this.turn, h("div", { className: "row" }, this.middle, this.byPairs, this.last));
    this.back = button("Back to where A lies", async () => this.onPose(null));
    this.keep = button("Keep as a copy", () => this.keepCopy());
    this.verdict = h("p", { className: "verdict", id: "reach", role: "status", hidden: true });
    this.found = h("div", { className: "section", id: "alignment" });
    this.element = h("section", { className: "section", "aria-labelledby": "align-title" },
      h("header", {}, h("h2", { id: "align-title" }, "Alignment"), this.button, this.picker),
      h("div", { className: "form" }, h("label", {}, "Fit", this.fit), h("label", {}, "Motion", this.motion), h("label", {}, "Start from", this.start),
        h("label", {}, "Farthest points that do not count, %", this.trim), h("label", { className: "check whole" }, this.mirror, "Also as a mirror image")),
      this.picking, this.search.element, this.verdict, this.found, h("div", { className: "row" }, this.back, this.keep));
    this.draw();
  }

  /** What is asked for beside the meshes. @param {AlignmentRequest["landmarks"]} [landmarks] */
  question(landmarks) {
    const trim = Number(this.trim.value);
    if (!(trim >= 0 && trim <= MOST_TRIM)) throw new Error(`The share of points that do not count is a number from 0 to ${MOST_TRIM}.`);
    return /** @type {Partial<AlignmentRequest>} */ ({
      fit: this.fit.value, motion: this.motion.value, ...(this.fit.value === "min_max" || trim === 0 ? {} : { trim: trim / 100 }), ...(this.mirror.checked ? { mirror: true } : {}),
      ...(landmarks ? { start: "landmarks", landmarks } : { start: this.start.value }) });
  }

  /** @param {AlignmentRequest["landmarks"]} [landmarks] from where they belong together */
  async align(landmarks) {
    const { b } = state;
    if (state.a === null || b === null) return;
    const before = poseOfA();
    const { id, result: answer } = await this.search.run({ type: "alignment", a: moved(), b, quads: this.quads(), ...this.question(landmarks) });
    const result = /** @type {AlignmentResult} */ (answer);
    this.endPick();
    this.onPose(before ? multiply(result.transform, before) : result.transform);
    this.result = result;
    setParameters({ alignment: id });
    this.draw();
  }

  /** The figures of a link, whose pose A has already, and what was asked for. */
  async restore() {
    const id = parameter("alignment");
    if (!id || this.result || !poseOfA()) return;
    const job = await client.jobs.get(id);
    if (this.result || job.type !== "alignment" || !job.result) return;
    this.result = /** @type {AlignmentResult} */ (job.result);
    this.fill(job.request);
    this.draw();
  }

  /** @param {Job["request"]} request */
  fill({ fit, motion, start, trim, mirror }) {
    this.fit.value = fit ?? this.fit.value;
    this.motion.value = motion ?? this.motion.value;
    if (start !== "landmarks") this.start.value = start ?? this.start.value;
    this.trim.value = String(Number((100 * (trim ?? 0)).toPrecision(9)));
    this.mirror.checked = mirror === true;
  }

  async pick() {
    const stage = currentStage();
    if (!stage) throw new Error("There is no 3D view to click in.");
    const { Landmarks } = await import("./landmarks.js");
    this.picking.hidden = false;
    this.landmarks = new Landmarks(stage, (turn) => this.drawTurn(turn));
  }

  endPick() {
    this.picker.setAttribute("aria-pressed", "false");
    this.picking.hidden = true;
    if (!this.landmarks) return;
    this.landmarks.dispose();
    this.landmarks = null;
    this.onTurn(null);
  }

  /** @param {Role} turn */
  drawTurn(turn) {
    this.onTurn(turn);
    const pairs = this.landmarks?.pairs.length ?? 0;
    const words = turn === "a" ? `Click a place of A${pairs > 0 ? `, or align by the ${pairs} pair${pairs === 1 ? "" : "s"}` : ""}.` : "Click the same place of B.";
    this.turn.textContent = pairs < LEAST_PAIRS && turn === "a" ? `Click a place of A; ${LEAST_PAIRS} pairs or more are wanted, ${pairs} are there.` : words;
    this.byPairs.disabled = pairs < LEAST_PAIRS;
    this.last.disabled = !this.landmarks?.places.length;
  }

  draw() {
    const isReady = state.a !== null && state.b !== null;
    this.button.disabled = this.picker.disabled = !isReady || this.search.isRunning;
    this.back.hidden = this.keep.hidden = poseOfA() === null;
    this.trim.disabled = this.fit.value === "min_max"; // all points count there
    this.drawVerdict();
    if (!this.result) this.found.replaceChildren(h("p", { className: "muted" }, poseOfA() ? "A is moved." : "Moves A onto B, and tells how far apart they are then."));
    else this.found.replaceChildren(figures(rowsOf(this.result), "figures single"), isAmbiguous(this.result) ? h("p", { className: "muted small" }, "Another motion fits about as well: A may be symmetric.") : "");
  }

  /** Is the limit met, or can no motion meet it? */
  drawVerdict() {
    const limit = this.limit();
    this.verdict.hidden = !this.result || limit === null;
    if (!this.result || limit === null) return;
    const { floor, hausdorff: { lower, upper } } = this.result;
    const isHopeless = floor !== null && floor > limit;
    const isWithin = upper !== null && upper <= limit;
    this.verdict.className = `verdict${isHopeless || lower > limit ? " fault" : isWithin ? " good" : ""}`;
    this.verdict.textContent = isHopeless ? `No motion brings A within ${limit} of B: that is proven.`
      : isWithin ? `A is within ${limit} of B here.` : lower > limit ? `A is not within ${limit} of B here; another motion may bring it there.`
      : `Whether A is within ${limit} of B here is not certain.`;
  }

  async keepCopy() {
    const transform = poseOfA();
    if (!transform || state.a === null) return;
    const copy = await client.meshes.copy(state.a, transform, { name: `${nameOf(state.a)}, aligned` });
    await refreshMeshes();
    state.a = copy.id;
    say(`${copy.name} is here.`);
    changed("choice");
  }

  /** A is moved otherwise, or another one. */
  forget() {
    this.search.leave();
    this.endPick();
    this.result = null;
    this.draw();
  }
}

/** @param {AlignmentResult} result @returns {[string, string][]} */
function rowsOf({ rms, floor, scale, mirrored, certainty: { runner_up_rms: second }, hausdorff: { lower, upper } }) {
  return [
    ["RMS of the distances that count", length(rms, DIGITS)],
    ["Hausdorff distance, proven", intervals([{ lower, upper }], ENOUGH)[0]],
    ["No motion gets below, proven", floor === null ? "not known with a scale" : length(floor, DIGITS)],
    ["RMS of the runner-up", second === null ? "none: all starts ended here" : length(second, DIGITS)],
    ...(mirrored ? [/** @type {[string, string]} */ (["Mirror image", "yes"])] : []),
    ...(scale === 1 ? [] : [/** @type {[string, string]} */ (["Scale", length(scale, 6)])])];
}

/** @param {AlignmentResult} result */
function isAmbiguous({ rms, certainty: { runner_up_rms: second } }) {
  return second !== null && second <= ALIKE * rms + ALIKE_SHARE * (meshOf(state.a)?.bounding_box.diagonal ?? 0);
}
