// The section of the alignment: moves A onto B, by itself or by landmarks, and tells how well it fits.

import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { figures, h, select } from "../core/dom.js";
import { ENOUGH, intervals, length } from "../core/format.js";
import { run, say } from "../core/messages.js";
import { Search } from "../core/search.js";
import { changed, nameOf, state } from "../core/state.js";
import { toggle } from "../view/tools.js";
import { currentStage } from "../view/view.js";
import { multiply } from "../view/transform.js";
import { moved, pose } from "./pose.js";

/** @import { AlignmentRequest, AlignmentResult, QuadReading, Transform } from "../../js/types.js" */
/** @import { Role } from "../view/stage.js" */
/** @import { Landmarks } from "./landmarks.js" */

const LEAST_PAIRS = 3;
const DIGITS = 4;

export class AlignSection {
  /**
   * @param {object} options
   * @param {() => QuadReading} options.quads
   * @param {(transform: Transform | null) => void} options.onPose A is to be moved; null: to where it lies
   * @param {(turn: Role | null) => void} options.onTurn a place of A or B is to be clicked; null: no more
   */
  constructor({ quads, onPose, onTurn }) {
    this.quads = quads;
    this.onPose = onPose;
    this.onTurn = onTurn;
    this.search = new Search(() => "");
    /** @type {AlignmentResult | null} */
    this.result = null;
    /** @type {Landmarks | null} */
    this.landmarks = null;
    const button = (/** @type {string} */ words, /** @type {() => Promise<unknown>} */ action) => h("button", { type: "button", onclick: () => run(action) }, words);
    this.button = button("Align A onto B", () => this.align({ start: "principal" }));
    this.fit = select("fit", [["least_squares", "least squares"], ["min_max", "least maximum"]], "least_squares");
    this.motion = select("motion", [["rigid", "turn and shift"], ["rigid_scale", "turn, shift and scale"], ["translation", "shift alone"]], "rigid");
    this.picker = toggle("By landmarks", "Click pairs of places that belong together", false, (isOn) => run(async () => (isOn ? this.pick() : this.endPick())));
    this.byPairs = button("Align by these", () => this.align({ start: "landmarks", landmarks: this.landmarks?.pairs }));
    this.last = button("Take the last back", async () => this.landmarks?.takeBack());
    this.turn = h("p", { id: "landmarks", role: "status" });
    this.picking = h("div", { className: "section", hidden: true }, this.turn, h("div", { className: "row" }, this.byPairs, this.last));
    this.back = button("Back to where A lies", async () => this.onPose(null));
    this.keep = button("Keep as a copy", () => this.keepCopy());
    this.found = h("div", { className: "section", id: "alignment" });
    this.element = h("section", { className: "section", "aria-labelledby": "align-title" },
      h("header", {}, h("h2", { id: "align-title" }, "Alignment"), this.button, this.picker),
      h("div", { className: "form" }, h("label", {}, "Fit", this.fit), h("label", {}, "Motion", this.motion)),
      this.picking, this.search.element, this.found, h("div", { className: "row" }, this.back, this.keep));
    this.draw();
  }

  /** @param {Pick<AlignmentRequest, "start" | "landmarks">} start */
  async align(start) {
    if (state.a === null || state.b === null) return;
    const before = pose.transform;
    const { result: answer } = await this.search.run({
      type: "alignment", a: moved(), b: state.b, quads: this.quads(), fit: /** @type {any} */ (this.fit.value), motion: /** @type {any} */ (this.motion.value), ...start });
    const result = /** @type {AlignmentResult} */ (answer);
    this.endPick();
    this.onPose(before ? multiply(result.transform, before) : result.transform);
    this.result = result;
    this.draw();
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
    this.back.hidden = this.keep.hidden = pose.transform === null;
    if (!this.result) this.found.replaceChildren(h("p", { className: "muted" }, pose.transform ? "A is moved." : "Moves A onto B, and tells how far apart they are then."));
    else this.found.replaceChildren(figures(rowsOf(this.result), "figures single"));
  }

  async keepCopy() {
    const { transform } = pose;
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
function rowsOf({ rms, floor, scale, certainty: { runner_up_rms: second }, hausdorff: { lower, upper } }) {
  return [
    ["RMS of the distances that count", length(rms, DIGITS)],
    ["Hausdorff distance, proven", intervals([{ lower, upper }], ENOUGH)[0]],
    ["No motion gets below, proven", floor === null ? "not known with a scale" : length(floor, DIGITS)],
    ["RMS of the runner-up", second === null ? "none: all starts ended here" : length(second, DIGITS)],
    ...(scale === 1 ? [] : [/** @type {[string, string]} */ (["Scale", length(scale, 6)])])];
}
