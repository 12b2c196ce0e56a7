// What the colours stand for, on the page and in pictures: a bar with its ends, or bands with their limits, and whose distances.

import { h } from "../core/dom.js";
import { length } from "../core/format.js";
import { BANDS, colourAt } from "../view/scale.js";

/** @import { Scale } from "../view/scale.js" */
/** @typedef {{ title: string, error: number, isClamped: boolean }} Words error: how far the colours may be off between the vertices;
 *   isClamped: there is something beyond the ends */
/** @typedef {{ left: number, top: number, width: number, height: number }} Place */

/** @param {[number, number, number]} colour */
const css = (colour) => `rgb(${colour.map((x) => Math.round(255 * x)).join(" ")})`;

/** The values at the ends and in the middle. @param {Scale} scale @param {boolean} isClamped */
function ticks({ low, high, isSigned }, isClamped) {
  const [first, last] = [length(low, 3), length(high, 3)];
  if (isSigned) return [`${isClamped ? "≤ " : ""}${first} inside`, low < 0 ? "0" : "", `outside ${isClamped ? "≥ " : "+"}${last}`];
  return [`${low > 0 ? "≤ " : ""}${first}`, length(low / 2 + high / 2, 3), `${isClamped ? "≥ " : ""}${last}`];
}

/** The bands in words, with their colours. @param {Scale} scale @returns {[string, string][]} */
function bandsOf({ limits, isSigned }) {
  const [low, high] = /** @type {[number, number]} */ (limits);
  const beyond = (/** @type {number} */ limit) => `more than ${length(Math.abs(limit), 3)} ${limit < 0 ? "inside" : "outside"}`;
  const words = isSigned ? [low < 0 ? beyond(low) : `less than ${length(low, 3)} outside, or inside`, "within both limits",
    high > 0 ? beyond(high) : `less than ${length(-high, 3)} inside, or outside`, "not known for certain here"]
    : ["", `within ${length(high, 3)}`, `beyond ${length(high, 3)}`, "not known for certain here"];
  return /** @type {[string, string][]} */ (words.map((word, place) => [css(BANDS[place]), word])).filter(([, word]) => word !== "");
}

/** @param {Words} words */
const wordsOfError = ({ error }) => (error === 0 ? "" : `off by ${roundedUp(error)} at most between the vertices`);

/** A number with two digits that is not below it. @param {number} value */
function roundedUp(value) {
  const step = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Number((Math.ceil(value / step) * step).toPrecision(2)).toString();
}

/** @param {Scale} scale @param {Words} words */
export function makeLegend(scale, words) {
  const { title, isClamped } = words;
  const error = wordsOfError(words);
  const head = [h("span", { className: "legend-title" }, title)];
  const foot = error && h("span", { className: "muted" }, error);
  if (scale.limits) return h("div", { className: "legend" }, ...head, ...bandsOf(scale).map(([colour, band]) => h("span", { className: "band" }, swatch(colour), band)), foot);
  const [low, middle, high] = ticks(scale, isClamped);
  const canvas = h("canvas", { width: 256, height: 1, role: "img", "aria-label": `Colours from ${low} to ${high}` });
  const context = canvas.getContext("2d");
  if (context) drawColours(context, scale, { left: 0, top: 0, width: 256, height: 1 });
  return h("div", { className: "legend" }, ...head, canvas, h("div", { className: "ticks" }, ...[low, middle, high].map((value) => h("span", {}, value))), foot);
}

/** @param {string} colour */
function swatch(colour) {
  const element = h("span", { className: "swatch" });
  element.style.background = colour;
  return element;
}

/** @param {CanvasRenderingContext2D} context @param {Scale} scale @param {Place} place */
function drawColours(context, scale, { left, top, width, height }) {
  for (let i = 0; i < width; i++) {
    context.fillStyle = css(/** @type {[number, number, number]} */ (colourAt(scale, i / (width - 1))));
    context.fillRect(left + i, top, 1, height);
  }
}

/**
 * The legend in the right bottom corner of a picture, on a ground of its own.
 * @param {CanvasRenderingContext2D} context
 * @param {Scale} scale
 * @param {Words} words
 */
export function drawLegend(context, scale, words) {
  const ratio = devicePixelRatio;
  const error = wordsOfError(words);
  const lines = scale.limits ? bandsOf(scale) : [];
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  const line = 18 * ratio;
  const width = Math.min(context.canvas.width - 2 * line, Math.max(260 * ratio, ...[words.title, error].map((text) => context.measureText(text).width)));
  const rows = (scale.limits ? lines.length : 2) + 1 + (error ? 1 : 0);
  const box = { left: context.canvas.width - width - line, top: context.canvas.height - rows * line - line, width, height: rows * line };
  const style = getComputedStyle(document.body);
  context.fillStyle = style.backgroundColor;
  context.fillRect(box.left - line / 2, box.top - line / 2, width + line, box.height + line);
  context.fillStyle = style.color;
  context.textAlign = "left";
  context.textBaseline = "middle";
  const write = (/** @type {string} */ text, /** @type {number} */ row, left = 0) => context.fillText(text, box.left + left, box.top + (row + 0.5) * line, width - left);
  write(words.title, 0);
  lines.forEach(([colour, text], place) => {
    context.fillStyle = colour;
    context.fillRect(box.left, box.top + (place + 1.2) * line, 0.6 * line, 0.6 * line);
    context.fillStyle = style.color;
    write(text, place + 1, line);
  });
  if (!scale.limits) drawBar(context, scale, words, { ...box, top: box.top + 1.2 * line, height: 0.6 * line }, line);
  context.fillStyle = style.color;
  context.textAlign = "left";
  if (error) write(error, rows - 1);
}

/** @param {CanvasRenderingContext2D} context @param {Scale} scale @param {Words} words @param {Place} bar @param {number} line */
function drawBar(context, scale, { isClamped }, bar, line) {
  const ink = context.fillStyle;
  drawColours(context, scale, bar);
  context.fillStyle = ink;
  const aligns = /** @type {CanvasTextAlign[]} */ (["left", "center", "right"]);
  ticks(scale, isClamped).forEach((value, place) => {
    context.textAlign = aligns[place];
    context.fillText(value, bar.left + (place / 2) * bar.width, bar.top + 1.3 * line);
  });
}
