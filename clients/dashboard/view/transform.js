// Moves points and boxes by a matrix of 4 x 4, column by column, as the API has it.

/** @import { Mesh, Point, Transform } from "../../js/types.js" */
/** @typedef {Mesh["bounding_box"]} Box */

/** One motion after another. @param {Transform} after @param {Transform} before @returns {Transform} */
export function multiply(after, before) {
  return Array.from({ length: 16 }, (_, place) => {
    const [row, column] = [place % 4, place - (place % 4)];
    return [0, 1, 2, 3].reduce((sum, k) => sum + after[row + 4 * k] * before[column + k], 0);
  });
}

/** @param {Transform} t @param {ArrayLike<number>} point @returns {Point} */
export const movePoint = (t, { 0: x, 1: y, 2: z }) => /** @type {Point} */ ([0, 1, 2].map((k) => t[k] * x + t[4 + k] * y + t[8 + k] * z + t[12 + k]));

/** Moves rows of x, y, z where they are. @param {Transform} t @param {Float64Array} points */
export function movePoints(t, points) {
  for (let at = 0; at < points.length; at += 3) points.set(movePoint(t, points.subarray(at, at + 3)), at);
}

/** A box round a moved box. @param {Box} box @param {Transform | null} transform @returns {Box} */
export function moveBox(box, transform) {
  if (!transform) return box;
  const corners = Array.from({ length: 8 }, (_, n) => movePoint(transform, [0, 1, 2].map((k) => (n & (1 << k) ? box.max : box.min)[k])));
  const [min, max] = [Math.min, Math.max].map((pick) => /** @type {Point} */ ([0, 1, 2].map((k) => pick(...corners.map((corner) => corner[k])))));
  return { min, max, diagonal: Math.hypot(...max.map((high, k) => high - min[k])) };
}
