// A plane across the view: what of a ray lies on the side that is kept, and the curves in which it cuts a model.

import { Vector3 } from "three";

/** @import { Ray } from "three" */
/** @import { Model } from "./model.js" */
/** @typedef {{ axis: number, at: number, side: 1 | -1 }} Plane across an axis, in the scene; side 1: what lies beyond is taken away */

/** For shaders: a point is taken away where its product with the first three is above the fourth. @param {Plane | null} plane */
export const toUniform = (plane) => (plane
  ? [...[0, 1, 2].map((k) => (k === plane.axis ? plane.side : 0)), plane.side * plane.at] : [0, 0, 0, 1]);

/** Between which distances along it a ray is on the side that is kept. @param {Plane | null} plane @param {Ray} ray @returns {[number, number]} */
export function keptPart(plane, { origin, direction }) {
  if (!plane) return [0, Infinity];
  const room = plane.side * (plane.at - origin.getComponent(plane.axis));
  const speed = plane.side * direction.getComponent(plane.axis);
  if (speed === 0) return room >= 0 ? [0, Infinity] : [0, 0];
  return speed > 0 ? [0, Math.max(0, room / speed)] : [Math.max(0, room / speed), Infinity];
}

/** Where a plane cuts the triangles of a model, in the scene. @param {Plane} plane @param {Model} model @returns {[Vector3, Vector3][]} */
export function cutModel({ axis, at }, { pieces, group }) {
  const { position: shift, scale: { x: scale } } = group;
  const own = (at - shift.getComponent(axis)) / scale;
  /** @type {[Vector3, Vector3][]} */
  const found = [];
  for (const { geometry } of pieces) {
    const points = geometry.getAttribute("position").array;
    for (let first = 0; first < points.length; first += 9) {
      const ends = cutTriangle(points, first, axis, own);
      if (ends) found.push(/** @type {[Vector3, Vector3]} */ (ends.map((end) => end.multiplyScalar(scale).add(shift))));
    }
  }
  return found;
}

/** @param {ArrayLike<number>} points @param {number} first @param {number} axis @param {number} at */
function cutTriangle(points, first, axis, at) {
  const heights = [0, 3, 6].map((corner) => points[first + corner + axis] - at);
  if ((heights[0] < 0) === (heights[1] < 0) && (heights[1] < 0) === (heights[2] < 0)) return null;
  return [0, 1, 2].flatMap((k) => {
    const next = (k + 1) % 3;
    if ((heights[k] < 0) === (heights[next] < 0)) return [];
    const share = heights[k] / (heights[k] - heights[next]);
    const [from, to] = [k, next].map((corner) => new Vector3(points[first + 3 * corner], points[first + 3 * corner + 1], points[first + 3 * corner + 2]));
    return [from.lerp(to, share)];
  });
}
