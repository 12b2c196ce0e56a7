// Strokes in the window by mouse, pen or touch; the other button, or a second finger, turns the view. An end of a curve may be
// held and put elsewhere.

import { MOUSE, TOUCH } from "three";

import { byId, h } from "../core/dom.js";
import { listenToKeys } from "./keys.js";

/** @import { Stage } from "../view/stage.js" */
/** @import { Target } from "./window.js" */
/** @typedef {[number, number][]} Track points of the window, from the view's left top corner */

const LEAST_STEP = 3;
const CLICK_LENGTH = 5;

/** The length of a track. @param {Track} track */
const lengthOf = (track) => track.slice(1).reduce((sum, [x, y], i) => sum + Math.hypot(x - track[i][0], y - track[i][1]), 0);

/** A mark of the page over the view. @param {string} className */
const mark = (className) => h("span", { className, hidden: true });

/** @param {HTMLElement} shown @param {Target | null} target */
function putMark(shown, target) {
  shown.hidden = target === null;
  if (!target) return;
  shown.dataset.kind = target.kind;
  [shown.style.left, shown.style.top] = [`${target.x}px`, `${target.y}px`];
}

/**
 * @template Grip
 * @param {Stage} stage
 * @param {{ onStroke: (track: Track, isFree: boolean) => void, onClick: (x: number, y: number) => void, onDrop: (grip: Grip, target: Target | null, track: Track) => void,
 *   gripAt: (x: number, y: number) => Grip | null, targetAt: (x: number, y: number) => Target | null }} options
 *   isFree: its ends are to snap to nothing; gripAt: what can be held and dragged there; targetAt: what an end there would snap to
 * @returns {{ look: () => void, putAway: () => void }} look: again at what the pen hovers over
 */
export function takePen(stage, { onStroke, onClick, onDrop, gripAt, targetAt }) {
  const { canvas, eye: { controls } } = stage;
  const ink = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
  ink.setAttribute("class", "ink");
  ink.setAttribute("aria-hidden", "true");
  ink.append(line);
  const [start, end] = [mark("snap"), mark("snap")];
  byId("canvas").append(ink, start, end);
  const before = { buttons: { ...controls.mouseButtons }, touches: { ...controls.touches } };
  controls.mouseButtons = { LEFT: null, MIDDLE: MOUSE.PAN, RIGHT: MOUSE.ROTATE };
  controls.touches = { ONE: null, TWO: TOUCH.DOLLY_ROTATE };
  canvas.classList.add("draws");
  /** @type {{ pointer: number, track: Track, grip: Grip | null } | null} */
  let stroke = null;
  const fingers = new Set();
  /** Where the pen hovers. @type {[number, number] | null} */
  let hover = null;
  /** Is Alt down: do ends snap to nothing? */
  let isFree = false;

  /** @param {PointerEvent} event @returns {[number, number]} */
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  /** @param {Track} track */
  const drawTrack = (track) => line.setAttribute("points", track.map((point) => point.join()).join(" "));
  const drop = () => {
    stroke = hover = null;
    drawTrack([]);
    putMark(start, null);
    putMark(end, null);
  };
  /** @param {PointerEvent} event */
  const down = (event) => {
    fingers.add(event.pointerId);
    if (fingers.size > 1) {
      drop();
    } else if (event.button === 0) {
      const place = at(event);
      stroke = { pointer: event.pointerId, track: [place], grip: gripAt(...place) };
      if (!stroke.grip) putMark(start, event.altKey ? null : targetAt(...place));
    }
  };
  /** @param {PointerEvent} event */
  const move = (event) => {
    const isMine = stroke?.pointer === event.pointerId;
    hover = event.buttons === 0 || isMine ? at(event) : null;
    isFree = event.altKey;
    look();
    if (!stroke || !isMine) return;
    const { track, grip } = stroke;
    if (grip) track.splice(1, Infinity, at(event));
    const events = grip ? [] : event.getCoalescedEvents?.() ?? [];
    for (const each of events.length > 0 || grip ? events : [event]) {
      const [x, y] = at(each);
      const last = track[track.length - 1];
      if (Math.hypot(x - last[0], y - last[1]) >= LEAST_STEP) track.push([x, y]);
    }
    drawTrack(track);
  };
  /** @param {PointerEvent} event */
  const up = (event) => {
    fingers.delete(event.pointerId);
    if (stroke?.pointer !== event.pointerId) return;
    const { track, grip } = stroke;
    drop();
    if (event.type === "pointercancel") return;
    if (lengthOf(track) < CLICK_LENGTH) onClick(...track[0]);
    else if (grip) onDrop(grip, targetAt(...at(event)), track);
    else onStroke(track, event.altKey);
  };
  const look = () => putMark(end, hover && !isFree ? targetAt(...hover) : null);
  const leave = () => {
    hover = stroke ? hover : null;
    look();
  };
  const listeners = /** @type {[string, any][]} */ ([["pointerdown", down], ["pointermove", move], ["pointerup", up],
    ["pointercancel", up], ["pointerleave", leave]]);
  for (const [name, listener] of listeners) canvas.addEventListener(name, listener);
  const stopKeys = listenToKeys(canvas, {
    place: byId("canvas"),
    onMove: (track) => {
      drawTrack(track);
      putMark(start, targetAt(...track[0]));
      putMark(end, track.length > 1 ? targetAt(...track[track.length - 1]) : null);
    },
    onEnd: (track) => {
      drop();
      if (!track) return;
      if (lengthOf(track) < CLICK_LENGTH) onClick(...track[0]);
      else onStroke(track, false);
    } });
  const putAway = () => {
    stopKeys();
    for (const [name, listener] of listeners) canvas.removeEventListener(name, listener);
    controls.mouseButtons = before.buttons;
    controls.touches = before.touches;
    canvas.classList.remove("draws");
    for (const element of [ink, start, end]) element.remove();
  };
  return { look, putAway };
}
