// Both bounds over time, on a logarithmic scale: the band between them holds the distance.

import { prepare } from "../core/canvas.js";
import { colour } from "../core/dom.js";
import { duration } from "../core/format.js";

/** @typedef {{ elapsed_ms: number, lower: number, upper: number | null }} Sample */

const LEFT = 58;
const RIGHT = 14;
const TOP = 12;
const BOTTOM = 24;
const MOST_DECADES = 9;

/**
 * The powers of ten that hold all samples.
 * @param {Sample[]} samples
 * @param {number | null} limit
 */
function range(samples, limit) {
  const values = samples.flatMap(({ lower, upper }) => [lower, upper ?? 0]).concat(limit ?? 0).filter((value) => value > 0);
  if (values.length === 0) return { low: -3, high: 0 };
  const high = Math.ceil(Math.log10(Math.max(...values)) + 1e-9);
  const low = Math.floor(Math.log10(Math.min(...values)) - 1e-9);
  return { low: Math.max(Math.min(low, high - 1), high - MOST_DECADES), high };
}

/** Steps of 1, 2 or 5 times a power of ten. @param {number} span @param {number} most */
function niceStep(span, most) {
  const rough = span / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= rough) ?? 10 * power;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Sample[]} samples
 * @param {number | null} limit
 */
export function drawChart(canvas, samples, limit) {
  const { context, width, height } = prepare(canvas);
  const { low, high } = range(samples, limit);
  const begin = samples[0]?.elapsed_ms ?? 0; // what was waited for before is no part of it
  const end = Math.max(begin + 1e-3, samples.at(-1)?.elapsed_ms ?? 0);
  const x = (/** @type {number} */ ms) => LEFT + ((ms - begin) / (end - begin)) * (width - LEFT - RIGHT);
  const y = (/** @type {number} */ value) => {
    const place = value > 0 ? (Math.log10(value) - low) / (high - low) : 0;
    return height - BOTTOM - Math.max(0, Math.min(1, place)) * (height - TOP - BOTTOM);
  };
  drawAxes(context, { x, y, low, high, begin, end, width, height, isEmpty: samples.length === 0 });
  if (limit !== null && limit > 0) {
    context.strokeStyle = colour("--ink");
    context.setLineDash([5, 4]);
    line(context, [[LEFT, y(limit)], [width - RIGHT, y(limit)]]);
    context.setLineDash([]);
    context.fillStyle = colour("--ink");
    context.textAlign = "left";
    context.fillText("limit", LEFT + 4, y(limit) - 6);
  }
  drawBand(context, samples, x, y, TOP);
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {{ x: (ms: number) => number, y: (value: number) => number, low: number, high: number, begin: number, end: number,
 *   width: number, height: number, isEmpty: boolean }} scale
 */
function drawAxes(context, { x, y, low, high, begin, end, width, height, isEmpty }) {
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  context.strokeStyle = colour("--line");
  context.fillStyle = colour("--muted");
  context.textAlign = "right";
  context.textBaseline = "middle";
  const step = Math.ceil((high - low) / 5);
  for (let power = low; power <= high; power += step) {
    line(context, [[LEFT, y(10 ** power)], [width - RIGHT, y(10 ** power)]]);
    context.fillText(power >= -3 && power <= 4 ? String(Number((10 ** power).toPrecision(1))) : `1e${power}`, LEFT - 8, y(10 ** power));
  }
  if (isEmpty) return;
  context.textBaseline = "alphabetic";
  context.textAlign = "center";
  const every = niceStep(end - begin, 4);
  for (let ms = Math.ceil(begin / every) * every; ms <= end * 1.0001; ms += every) {
    context.textAlign = x(ms) > width - 40 ? "right" : x(ms) < LEFT + 20 ? "left" : "center";
    context.fillText(ms === 0 ? "0" : every < 1 ? `${ms.toFixed(Math.ceil(-Math.log10(every)))} ms` : duration(ms), x(ms), height - 7);
  }
}

/**
 * Each bound holds until the next one comes.
 * @param {CanvasRenderingContext2D} context
 * @param {Sample[]} samples
 * @param {(ms: number) => number} x
 * @param {(value: number) => number} y
 * @param {number} top
 */
function drawBand(context, samples, x, y, top) {
  /** @param {(sample: Sample) => number} place */
  const steps = (place) => samples.flatMap((sample, i) =>
    /** @type {[number, number][]} */ (i === 0 ? [[x(sample.elapsed_ms), place(sample)]]
      : [[x(sample.elapsed_ms), place(samples[i - 1])], [x(sample.elapsed_ms), place(sample)]]));
  const upper = steps(({ upper: value }) => (value === null ? top : y(value)));
  const lower = steps(({ lower: value }) => y(value));
  if (samples.length === 0) return;
  context.fillStyle = colour("--between");
  context.beginPath();
  for (const [px, py] of [...upper, ...lower.reverse()]) context.lineTo(px, py);
  context.fill();
  context.lineWidth = 2;
  context.lineJoin = "round";
  for (const [points, name] of /** @type {[[number, number][], string][]} */ ([[upper, "--upper"], [lower, "--lower"]])) {
    context.strokeStyle = context.fillStyle = colour(name);
    line(context, points);
    const [px, py] = points.reduce((last, point) => (point[0] >= last[0] ? point : last));
    context.beginPath();
    context.arc(px, py, 3, 0, 2 * Math.PI);
    context.fill();
  }
}

/** @param {CanvasRenderingContext2D} context @param {[number, number][]} points */
function line(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}
