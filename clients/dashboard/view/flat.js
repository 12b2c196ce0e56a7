// Which faces are flat and convex: over such a face the distance from it is a convex function.

/** @import { Shape } from "./ply.js" */

/** How far rounding may put a corner, or a foot, off a face: a share of the face's size. */
const FLAT = 1e-12;

export class FlatFaces {
  /** @param {Shape} shape */
  constructor(shape) {
    this.shape = shape;
    /** Corners and unit normal of each face that was asked for; null where it is not flat and convex.
     * @type {Map<number, { corners: number[][], normal: number[], near: number } | null>} */
    this.known = new Map();
  }

  /** @param {number} face */
  planeOf(face) {
    let plane = this.known.get(face);
    if (plane === undefined) this.known.set(face, plane = findPlane(this.shape, face));
    return plane;
  }

  /**
   * Is a face flat and convex, and are these points on it? A point on a side is on both faces.
   * @param {number} face
   * @param {ArrayLike<number>[]} points
   */
  holds(face, points) {
    const plane = this.planeOf(face);
    return plane !== null && points.every((point) => isOn(plane, point));
  }
}

/** @param {Shape} shape @param {number} face */
function findPlane({ points, corners, starts }, face) {
  const all = Array.from(corners.subarray(starts[face], starts[face + 1]), (vertex) => [...points.subarray(3 * vertex, 3 * vertex + 3)]);
  const turns = all.map((corner, k) => cross(minus(all[(k + 1) % all.length], corner), minus(all[(k + 2) % all.length], all[(k + 1) % all.length])));
  const sum = turns.reduce((total, turn) => total.map((value, k) => value + turn[k]));
  const length = Math.hypot(...sum);
  if (!(length > 0) || turns.some((turn) => dot(turn, sum) <= 0)) return null;
  const plane = { corners: all, normal: sum.map((value) => value / length), near: FLAT * Math.sqrt(length) };
  return all.every((corner) => Math.abs(dot(minus(corner, all[0]), plane.normal)) <= plane.near) ? plane : null;
}

/** @param {{ corners: number[][], normal: number[], near: number }} plane @param {ArrayLike<number>} point */
function isOn({ corners, normal, near }, point) {
  if (Math.abs(dot(minus(point, corners[0]), normal)) > near) return false;
  return corners.every((corner, k) => {
    const side = minus(corners[(k + 1) % corners.length], corner);
    return dot(cross(side, minus(point, corner)), normal) >= -near * Math.hypot(...side);
  });
}

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {number[]} a @param {number[]} b */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
