// Canvases that are sharp on every screen, and the axis below a histogram.

import { colour } from "./dom.js";

const AXIS_HEIGHT = 20;

/** Clears a canvas and sets it up for pixels of the style sheet. @param {HTMLCanvasElement} canvas */
export function prepare(canvas) {
  const ratio = Math.min(3, devicePixelRatio);
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/**
 * An axis along the lower edge, with words at its left end, in the middle, and at its right end.
 * @param {CanvasRenderingContext2D} context
 * @param {string[]} words
 * @param {number} width
 * @param {number} height
 * @returns {number} the height on which the bars stand
 */
export function drawAxis(context, words, width, height) {
  const bottom = height - AXIS_HEIGHT;
  context.fillStyle = colour("--line");
  context.fillRect(0, bottom, width, 1);
  context.fillStyle = colour("--muted");
  context.font = "11px system-ui, sans-serif";
  const aligns = /** @type {CanvasTextAlign[]} */ (["left", "center", "right"]);
  words.forEach((text, place) => {
    context.textAlign = aligns[place];
    context.fillText(text, (place / 2) * width, height - 5);
  });
  return bottom;
}
