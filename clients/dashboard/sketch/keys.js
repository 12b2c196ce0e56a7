// A pen that is led by keys: D shows it in the middle of the view, the arrow keys move it, D puts it down and lifts it again, Escape puts
// it away. While it is shown, the arrow keys do not turn the view.

import { h } from "../core/dom.js";

/** @import { Track } from "./pen.js" */

const STEP = 12;
/** With Shift. */
const SMALL_STEP = 3;
const WAYS = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] });

/**
 * @param {HTMLCanvasElement} canvas
 * @param {{ place: HTMLElement, onMove: (track: Track) => void, onEnd: (track: Track | null) => void }} options
 *   place: where the pen is drawn; onMove: of what is drawn so far, one point before it is put down; onEnd: with the whole stroke, null without one
 * @returns {() => void} what puts it away
 */
export function listenToKeys(canvas, { place, onMove, onEnd }) {
  const pen = h("span", { className: "key-pen", hidden: true });
  place.append(pen);
  /** @type {Track} */
  let track = [];
  let isDown = false;

  const show = () => {
    const [x, y] = track[track.length - 1];
    pen.hidden = false;
    pen.classList.toggle("is-down", isDown);
    [pen.style.left, pen.style.top] = [`${x}px`, `${y}px`];
    onMove(track);
  };
  /** @param {Track | null} stroke */
  const end = (stroke) => {
    [track, isDown] = [[], false];
    pen.hidden = true;
    onEnd(stroke);
  };
  /** @param {[number, number]} way @param {number} step */
  const move = ([right, down], step) => {
    const [x, y] = track[track.length - 1];
    const next = /** @type {[number, number]} */ ([
      Math.max(0, Math.min(canvas.clientWidth - 1, x + step * right)), Math.max(0, Math.min(canvas.clientHeight - 1, y + step * down))]);
    if (isDown) track.push(next);
    else track = [next];
    show();
  };
  /** @param {KeyboardEvent} event */
  const listen = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const isShown = track.length > 0;
    if (event.key.toLowerCase() === "d") {
      if (isShown && isDown) end(track);
      else {
        isDown = isShown;
        if (!isShown) track = [[canvas.clientWidth / 2, canvas.clientHeight / 2]];
        show();
      }
    } else if (isShown && event.key === "Escape") end(null);
    else if (isShown && WAYS[event.key]) move(WAYS[event.key], event.shiftKey ? SMALL_STEP : STEP);
    else return;
    event.preventDefault();
    event.stopImmediatePropagation(); // the view has other uses for these keys
  };
  canvas.addEventListener("keydown", listen, { capture: true });
  return () => {
    canvas.removeEventListener("keydown", listen, { capture: true });
    pen.remove();
  };
}
