// What the colours of distances stand for: a range from blue to yellow, from inside to outside, or bands within and beyond limits.

import { scaleColour, signedColour } from "./colours.js";

/**
 * @typedef {object} Scale
 * @property {number} low the value of the first colour; below 0 when signed
 * @property {number} high the value of the last one
 * @property {boolean} isSigned
 * @property {[number, number] | null} limits bands instead: below the first, within, beyond the second
 */

/** The colours of bands: below, within, beyond, and where it is not known which. */
export const BANDS = /** @type {[number, number, number][]} */ ([[0.16, 0.36, 0.85], [0.35, 0.68, 0.4], [0.8, 0.2, 0.17], [0.93, 0.87, 0.55]]);

/**
 * The colour of a share of the way from low to high. 0 is the grey in the middle of a signed scale, wherever it lies.
 * @param {Scale} scale
 * @param {number} share from 0 to 1
 */
export function colourAt({ low, high, isSigned }, share) {
  if (!isSigned) return scaleColour(share);
  const value = low + share * (high - low);
  return signedColour(value < 0 ? 0.5 - (0.5 * value) / low : 0.5 + (0.5 * value) / high);
}

/**
 * The colour of a value that is known exactly.
 * @param {Scale} scale
 * @param {number} value
 */
export function colourOf(scale, value) {
  const { low, high, limits } = scale;
  if (limits) return BANDS[value < limits[0] ? 0 : value > limits[1] ? 2 : 1];
  return colourAt(scale, Math.max(0, Math.min(1, (value - low) / (high - low))));
}
