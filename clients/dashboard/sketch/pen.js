// Strokes in the window by mouse, pen or touch; the other button, or a second finger, turns the view.

import { MOUSE, TOUCH } from "three";

import { byId, h } from "../core/dom.js";

/** @import { Stage } from "../view/stage.js" */
/** @typedef {[number, number][]} Track points of the window, from the view's left top corner */

const LEAST_STEP = 3;
const CLICK_LENGTH = 5;

/** The lines of a track. @param {Track} track */
const lengthOf = (track) => track.slice(1).reduce((sum, [x, y], i) => sum + Math.hypot(x - track[i][0], y - track[i][1]), 0);

/**
 * @param {Stage} stage
 * @param {{ onStroke: (track: Track) => void, onClick: (x: number, y: number) => void,
 *   snapAt: (x: number, y: number) => [number, number] | null }} options snapAt: where an end at this place would go
 * @returns {() => void} what puts the pen away
 */
export function takePen(stage, { onStroke, onClick, snapAt }) {
  const { canvas, eye: { controls } } = stage;
  const ink = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
  ink.setAttribute("class", "ink");
  ink.setAttribute("aria-hidden", "true");
  ink.append(line);
  const snap = h("span", { className: "snap", hidden: true });
  byId("canvas").append(ink, snap);
  const before = { buttons: { ...controls.mouseButtons }, touches: { ...controls.touches } };
  controls.mouseButtons = { LEFT: null, MIDDLE: MOUSE.PAN, RIGHT: MOUSE.ROTATE };
  controls.touches = { ONE: null, TWO: TOUCH.DOLLY_ROTATE };
  canvas.classList.add("draws");
  /** @type {{ pointer: number, track: Track } | null} */
  let stroke = null;
  const fingers = new Set();

  /** @param {PointerEvent} event @returns {[number, number]} */
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const drop = () => {
    stroke = null;
    line.setAttribute("points", "");
  };
  /** @param {PointerEvent} event */
  const down = (event) => {
    fingers.add(event.pointerId);
    if (fingers.size > 1) drop();
    else if (event.button === 0) stroke = { pointer: event.pointerId, track: [at(event)] };
  };
  /** @param {PointerEvent} event */
  const move = (event) => {
    const place = snapAt(...at(event));
    snap.hidden = place === null;
    if (place) [snap.style.left, snap.style.top] = place.map((value) => `${value}px`);
    if (stroke?.pointer !== event.pointerId) return;
    const { track } = stroke;
    const events = event.getCoalescedEvents?.() ?? [];
    for (const each of events.length > 0 ? events : [event]) {
      const [x, y] = at(each);
      const last = track[track.length - 1];
      if (Math.hypot(x - last[0], y - last[1]) >= LEAST_STEP) track.push([x, y]);
    }
    line.setAttribute("points", track.map((point) => point.join()).join(" "));
  };
  /** @param {PointerEvent} event */
  const up = (event) => {
    fingers.delete(event.pointerId);
    if (stroke?.pointer !== event.pointerId) return;
    const { track } = stroke;
    drop();
    if (event.type === "pointercancel") return;
    if (lengthOf(track) < CLICK_LENGTH) onClick(...track[0]);
    else onStroke(track);
  };
  const listeners = /** @type {[string, any][]} */ ([["pointerdown", down], ["pointermove", move], ["pointerup", up], ["pointercancel", up]]);
  for (const [name, listener] of listeners) canvas.addEventListener(name, listener);
  return () => {
    for (const [name, listener] of listeners) canvas.removeEventListener(name, listener);
    controls.mouseButtons = before.buttons;
    controls.touches = before.touches;
    canvas.classList.remove("draws");
    ink.remove();
    snap.remove();
  };
}
