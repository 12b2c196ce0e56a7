// The distance at a place of A: under the pointer while it hovers, and in labels that a click pins.

import { h } from "../core/dom.js";
import { length } from "../core/format.js";
import { run } from "../core/messages.js";
import { listenToClicks } from "../view/clicks.js";
import { Labels } from "../view/labels.js";
import { probe } from "../view/loader.js";
import { pick, prepare } from "../view/pick.js";

/** @import { Telling } from "../view/against.js" */
/** @import { Stage } from "../view/stage.js" */
/** @typedef {{ point: number[], distance: number, side: number, label: HTMLElement }} Pin side: 1 outside B, -1 inside, 0 not asked for or not known */

/** Of a place that was picked with the numbers of the graphics card more digits are not known. */
const DIGITS = 4;

export class Probe {
  /**
   * @param {Stage} stage
   * @param {{ quads: "triangles" | "bilinear", telling: () => Telling, onPins: () => void }} options
   */
  constructor(stage, { quads, telling, onPins }) {
    this.stage = stage;
    this.quads = quads;
    this.telling = telling;
    this.onPins = onPins;
    /** @type {Pin[]} */
    this.pins = [];
    this.tip = h("output", { className: "tip", hidden: true });
    this.labels = new Labels(stage);
    this.labels.place.append(this.tip);
    /** Where the pointer is, while that was not asked about. @type {[number, number] | null} */
    this.wanted = null;
    this.isAsking = false;
    this.stopClicks = listenToClicks(stage.canvas, (x, y) => run(() => this.pinAt(x, y)));
    const { canvas, eye } = stage;
    this.listeners = /** @type {[EventTarget, string, any][]} */ ([[canvas, "pointermove", this.move], [canvas, "pointerleave", this.leave]]);
    for (const [target, name, listener] of this.listeners) target.addEventListener(name, listener);
    eye.controls.addEventListener("change", this.hideTip);
    const a = this.model;
    this.ready = a && a.mesh.kind !== "points" ? prepare(a) : Promise.reject(new Error("Points have their own colours alone."));
    this.ready.catch(() => {});
  }

  get model() {
    return this.stage.models.get("a");
  }

  /** @param {PointerEvent} event @returns {[number, number]} */
  at(event) {
    const box = this.stage.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** @param {PointerEvent} event */
  move = (event) => {
    this.wanted = event.buttons === 0 ? this.at(event) : null;
    if (!this.wanted) this.tip.hidden = true;
    else this.look();
  };

  leave = () => {
    this.wanted = null;
    this.hideTip();
  };

  hideTip = () => { this.tip.hidden = true; };

  /** Asks for the place of the pointer, one at a time. */
  async look() {
    if (this.isAsking) return;
    this.isAsking = true;
    try {
      await this.ready;
      while (this.wanted) {
        const [x, y] = this.wanted;
        this.wanted = null;
        const found = await this.measureAt(x, y);
        this.tip.hidden = !found;
        if (!found) continue;
        this.tip.textContent = this.wordsOf(found);
        [this.tip.style.left, this.tip.style.top] = [`${x}px`, `${y}px`];
      }
    } catch {
      this.tip.hidden = true; // nobody asked for anything
    } finally {
      this.isAsking = false;
    }
  }

  /** The distance of what lies at a place of the window. @param {number} x @param {number} y */
  async measureAt(x, y) {
    const { model } = this;
    const found = model?.isWhole ? pick(this.stage, model, x, y) : null;
    return found && this.measure(found.point);
  }

  /** @param {number[]} point */
  async measure(point) {
    const b = this.stage.models.get("b");
    if (!b) return null;
    const { distance, side } = await probe(b, point, this.quads, this.telling());
    return { point, distance, side };
  }

  /** @param {{ distance: number, side: number }} found */
  wordsOf({ distance, side }) {
    // What is nearer than the numbers of the graphics card tell apart is at distance 0 as far as they know.
    const unknown = 2 ** -22 / (this.model?.frame.scale ?? 1);
    if (distance < unknown) return `under ${length(unknown, 1)}`;
    const unproven = this.telling() === "none" ? "" : ", side not known";
    return `${length(distance, DIGITS)}${side === 0 ? unproven : side < 0 ? " inside" : " outside"}`;
  }

  /** Pins a label. @param {number} x @param {number} y */
  async pinAt(x, y) {
    await this.ready;
    const found = await this.measureAt(x, y);
    if (found) this.add(found);
  }

  /** @param {{ point: number[], distance: number, side: number }} found */
  add(found) {
    const label = h("button", { type: "button", title: "Take this label away" }, this.wordsOf(found));
    const pin = { ...found, label };
    label.addEventListener("click", () => {
      this.pins = this.pins.filter((other) => other !== pin);
      this.labels.remove(label);
      this.onPins();
    });
    this.labels.add(found.point, label);
    this.pins.push(pin);
    this.onPins();
  }

  /** Pins of a link. @param {string | null} text */
  async restore(text) {
    await this.ready;
    for (const part of text?.split(";") ?? []) {
      const point = part.split(",").map(Number);
      const found = point.length === 3 && point.every(Number.isFinite) ? await this.measure(point) : null;
      if (found) this.add(found);
    }
  }

  /** For a link. */
  toText() {
    return this.pins.map(({ point }) => point.map((x) => Number(x.toPrecision(9))).join()).join(";");
  }

  /** Measures all pins again, for the sign is wanted now, or not any more. */
  async again() {
    for (const pin of this.pins) {
      const found = await this.measure(pin.point);
      if (found) pin.label.textContent = this.wordsOf(Object.assign(pin, found));
    }
  }

  dispose() {
    for (const [target, name, listener] of this.listeners) target.removeEventListener(name, listener);
    this.stage.eye.controls.removeEventListener("change", this.hideTip);
    this.stopClicks();
    this.labels.dispose();
  }
}
