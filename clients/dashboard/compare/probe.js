// The distance at a place of A: under the pointer while it hovers, and in labels that a click pins.

import { h } from "../core/dom.js";
import { length } from "../core/format.js";
import { run } from "../core/messages.js";
import { probe } from "../view/loader.js";
import { pick, prepare } from "../view/pick.js";
import { isSeen } from "../view/sight.js";

/** @import { Stage } from "../view/stage.js" */
/** @typedef {{ point: number[], distance: number, side: number, label: HTMLElement }} Pin side: 1 outside B, -1 inside, 0 not asked for */

const CLICK_LENGTH = 4;
/** Of a place that was picked with the numbers of the graphics card more digits are not known. */
const DIGITS = 4;

export class Probe {
  /**
   * @param {Stage} stage
   * @param {{ quads: "triangles" | "bilinear", isSigned: () => boolean, onPins: () => void }} options
   */
  constructor(stage, { quads, isSigned, onPins }) {
    this.stage = stage;
    this.quads = quads;
    this.isSigned = isSigned;
    this.onPins = onPins;
    /** @type {Pin[]} */
    this.pins = [];
    this.tip = h("output", { className: "tip", hidden: true });
    this.place = h("div", { className: "pins" }, this.tip);
    stage.place.append(this.place);
    /** Where the pointer is, while that was not asked about. @type {[number, number] | null} */
    this.wanted = null;
    this.isAsking = false;
    /** @type {[number, number] | null} */
    this.pressed = null;
    const { canvas, eye } = stage;
    this.listeners = /** @type {[EventTarget, string, any][]} */ ([[canvas, "pointermove", this.move], [canvas, "pointerleave", this.leave],
      [canvas, "pointerdown", this.press], [canvas, "pointerup", this.release]]);
    for (const [target, name, listener] of this.listeners) target.addEventListener(name, listener);
    eye.controls.addEventListener("change", this.draw);
    this.sizes = new ResizeObserver(this.draw);
    this.sizes.observe(stage.place);
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
    this.tip.hidden = true;
  };

  /** @param {PointerEvent} event */
  press = (event) => { this.pressed = event.button === 0 ? this.at(event) : null; };

  /** @param {PointerEvent} event */
  release = (event) => {
    const [x, y] = this.at(event);
    if (this.pressed && Math.hypot(x - this.pressed[0], y - this.pressed[1]) < CLICK_LENGTH) run(() => this.pinAt(x, y));
    this.pressed = null;
  };

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
    const { distance, side } = await probe(b, point, this.quads, this.isSigned());
    return { point, distance, side };
  }

  /** @param {{ distance: number, side: number }} found */
  wordsOf({ distance, side }) {
    // What is nearer than the numbers of the graphics card tell apart is at distance 0 as far as they know.
    const unknown = 2 ** -22 / (this.model?.frame.scale ?? 1);
    if (distance < unknown) return `under ${length(unknown, 1)}`;
    return `${length(distance, DIGITS)}${side === 0 ? "" : side < 0 ? " inside" : " outside"}`;
  }

  /** Pins a label. @param {number} x @param {number} y */
  async pinAt(x, y) {
    await this.ready;
    const found = await this.measureAt(x, y);
    if (found) this.add(found);
  }

  /** @param {{ point: number[], distance: number, side: number }} found */
  add(found) {
    const label = h("button", { type: "button", className: "pin", title: "Take this label away" }, this.wordsOf(found));
    const pin = { ...found, label };
    label.addEventListener("click", () => {
      this.pins = this.pins.filter((other) => other !== pin);
      label.remove();
      this.onPins();
    });
    this.place.append(label);
    this.pins.push(pin);
    this.draw();
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

  /** Where a pin is in the window, and whether it is seen. @param {Pin} pin */
  placeOf({ point }) {
    const { canvas, eye } = this.stage;
    const place = this.stage.toScene(point);
    const seen = isSeen(this.stage.opaqueModels(), eye.camera.position, place);
    const on = place.project(eye.camera);
    return { x: ((on.x + 1) / 2) * canvas.clientWidth, y: ((1 - on.y) / 2) * canvas.clientHeight, isSeen: seen, isThere: Math.abs(on.z) <= 1 };
  }

  draw = () => {
    this.tip.hidden = true;
    for (const pin of this.pins) {
      const { x, y, isSeen: seen, isThere } = this.placeOf(pin);
      pin.label.hidden = !isThere;
      pin.label.classList.toggle("is-hidden", !seen);
      [pin.label.style.left, pin.label.style.top] = [`${x}px`, `${y}px`];
    }
  };

  dispose() {
    for (const [target, name, listener] of this.listeners) target.removeEventListener(name, listener);
    this.stage.eye.controls.removeEventListener("change", this.draw);
    this.sizes.disconnect();
    this.place.remove();
  }
}

/** The pins of a picture. @param {CanvasRenderingContext2D} context @param {Probe} pinned */
export function drawPins(context, pinned) {
  const { stage, pins } = pinned;
  const ratio = context.canvas.width / stage.canvas.clientWidth;
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  context.textAlign = "left";
  const style = getComputedStyle(document.body);
  for (const pin of pins) {
    const { x, y, isThere } = pinned.placeOf(pin);
    if (!isThere) continue;
    const words = pin.label.textContent ?? "";
    const [left, top] = [x * ratio, y * ratio];
    context.fillStyle = style.backgroundColor;
    context.fillRect(left + 8 * ratio, top - 10 * ratio, context.measureText(words).width + 12 * ratio, 20 * ratio);
    context.fillStyle = style.color;
    context.beginPath();
    context.arc(left, top, 4 * ratio, 0, 2 * Math.PI);
    context.fill();
    context.fillText(words, left + 14 * ratio, top);
  }
}
