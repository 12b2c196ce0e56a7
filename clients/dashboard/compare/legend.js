// The colour bar of a heat map, on the page and in pictures.

import { h } from "../core/dom.js";
import { length } from "../core/format.js";
import { scaleColour, signedColour } from "../view/colours.js";

/** @typedef {{ top: number, isSigned: boolean }} Scale from 0, or from -top, to top */

/** @param {number} share from 0 to 1 @param {boolean} isSigned */
function css(share, isSigned) {
  return `rgb(${(isSigned ? signedColour : scaleColour)(share).map((x) => Math.round(255 * x)).join(" ")})`;
}

/** The values at the ends and in the middle. @param {Scale} scale */
const ticks = ({ top, isSigned }) => (isSigned ? [-top, 0, top] : [0, top / 2, top]).map((value) => length(value, 3));

/** @param {Scale} scale @param {string} words */
export function makeLegend(scale, words) {
  const [low, , high] = ticks(scale);
  const canvas = h("canvas", { width: 256, height: 1, role: "img", "aria-label": `Colours from ${low} to ${high}` });
  const context = canvas.getContext("2d");
  if (context) drawColours(context, scale, { left: 0, top: 0, width: 256, height: 1 });
  return h("div", { className: "legend" }, h("span", {}, words), canvas,
    h("div", { className: "ticks" }, ...ticks(scale).map((value) => h("span", {}, value))));
}

/** @param {CanvasRenderingContext2D} context @param {Scale} scale @param {{ left: number, top: number, width: number, height: number }} box */
function drawColours(context, { isSigned }, { left, top, width, height }) {
  for (let i = 0; i < width; i++) {
    context.fillStyle = css(i / (width - 1), isSigned);
    context.fillRect(left + i, top, 1, height);
  }
}

/** The bar in the right bottom corner of a picture. @param {CanvasRenderingContext2D} context @param {Scale} scale */
export function drawBar(context, scale) {
  const ratio = devicePixelRatio;
  const { width, height } = context.canvas;
  const bar = { left: width - Math.min(260 * ratio, width / 2) - 16 * ratio, top: height - 40 * ratio, width: Math.min(260 * ratio, width / 2), height: 12 * ratio };
  drawColours(context, scale, bar);
  context.fillStyle = getComputedStyle(document.body).color;
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  const aligns = /** @type {CanvasTextAlign[]} */ (["left", "center", "right"]);
  ticks(scale).forEach((value, place) => {
    context.textAlign = aligns[place];
    context.fillText(value, bar.left + (place / 2) * bar.width, bar.top + 28 * ratio);
  });
}
