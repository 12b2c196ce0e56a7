// How often a closed surface winds round a point, exactly: a ray from the point along x, and the sides to which the faces that it meets
// are turned. A ray that meets an edge or a corner is taken to run past it, at (0, e, e^2) from the point for an e as small as it takes
// (Edelsbrunner and Mücke 1990): then it meets exactly one of the faces that share it, or two, or none, whatever the order of the faces.

import { sideOfLine, sideOfPlane } from "./exact.js";

/** @import { Shape } from "./ply.js" */

const MOST_CELLS = 1024;

export class Winding {
  /**
   * @param {Shape} shape of a closed surface
   * @param {boolean} isBilinear quads are patches, not two triangles
   */
  constructor(shape, isBilinear) {
    this.shape = shape;
    const { corners, faces } = trianglesOf(shape);
    this.corners = corners;
    /** The quad that a triangle is a half of, where that is not flat: within the tetrahedron of its corners the patch and its triangles may
     * be on two sides of a point. */
    this.warped = isBilinear ? faces.map((face) => warpedOf(shape, face)) : [];
    const count = corners.length / 3;
    /** Cells a row of the grid over y and z. */
    this.side = Math.max(1, Math.min(MOST_CELLS, Math.ceil(Math.sqrt(count))));
    const ends = [1, 2].map((k) => [0, 1].map((high) => corners.reduce((end, _, corner) => (high ? Math.max : Math.min)(end, this.at(corner, k)), high ? -Infinity : Infinity)));
    this.low = ends.map(([low]) => low);
    this.step = ends.map(([low, high]) => (high - low) / this.side || 1);
    /** Where the triangles of each cell begin in the list of all. */
    this.first = new Uint32Array(this.side ** 2 + 1);
    this.visit((cell) => { this.first[cell + 1]++; });
    for (let cell = 0; cell < this.side ** 2; cell++) this.first[cell + 1] += this.first[cell];
    const filled = this.first.slice();
    this.list = new Uint32Array(this.first[this.side ** 2]);
    this.visit((cell, t) => { this.list[filled[cell]++] = t; });
  }

  /** @param {number} corner @param {number} k */
  at(corner, k) {
    return this.shape.points[3 * this.corners[corner] + k];
  }

  /** Calls with each triangle of each cell. @param {(cell: number, triangle: number) => void} act */
  visit(act) {
    for (let t = 0; 3 * t < this.corners.length; t++) {
      const [from, to] = [this.endOf(t, Math.min), this.endOf(t, Math.max)];
      for (let row = from[1]; row <= to[1]; row++) for (let column = from[0]; column <= to[0]; column++) act(row * this.side + column, t);
    }
  }

  /** The first or last column and row of a triangle, or of the quad round it. @param {number} t @param {(...all: number[]) => number} end */
  endOf(t, end) {
    const quad = this.warped[t];
    return [1, 2].map((k) => this.cellAt(quad ? end(...quad.map((corner) => corner[k])) : end(this.at(3 * t, k), this.at(3 * t + 1, k), this.at(3 * t + 2, k)), k - 1));
  }

  /** The column or row of a place; those beyond the ends count as in the last one. @param {number} x @param {number} k */
  cellAt(x, k) {
    return Math.max(0, Math.min(this.side - 1, Math.floor((x - this.low[k]) / this.step[k])));
  }

  /**
   * @param {ArrayLike<number>} point not on the surface
   * @returns {number | null} null: not known, as a patch's side of the point may be another one than that of its triangles, or the point is on the surface
   */
  of(point) {
    const { first, list, side } = this;
    const cell = this.cellAt(point[2], 1) * side + this.cellAt(point[1], 0);
    let winding = 0;
    for (let place = first[cell]; place < first[cell + 1]; place++) {
      const quad = this.warped[list[place]];
      if (quad && isWithin(quad, point)) return null;
      const turn = this.meets(3 * list[place], point);
      if (turn === null) return null;
      winding += turn;
    }
    return winding;
  }

  /** Does the ray from a point meet a triangle: 1 where it leaves through it, -1 where it enters, 0 not; null: the point is on it. @param {number} first corner @param {ArrayLike<number>} point */
  meets(first, point) {
    const [px, py, pz] = [point[0], point[1], point[2]];
    if (this.at(first, 0) < px && this.at(first + 1, 0) < px && this.at(first + 2, 0) < px) return 0;
    let turn = 0;
    for (let k = 0; k < 3; k++) {
      const [a, b] = [first + k, first + ((k + 1) % 3)];
      const [ay, az, by, bz] = [this.at(a, 1), this.at(a, 2), this.at(b, 1), this.at(b, 2)];
      const side = sideOfLine(ay, az, by, bz, py, pz) || Math.sign(az - bz) || Math.sign(by - ay);
      if (side === 0 || side === -turn) return 0;
      turn = side;
    }
    const corners = [0, 1, 2].map((k) => [0, 1, 2].map((axis) => this.at(first + k, axis)));
    const over = sideOfPlane(corners[0], corners[1], corners[2], point);
    // Seen along x the triangle turns to the left: its normal points along x.
    return over === 0 ? null : over === -turn ? turn : 0;
  }
}

/** The corners of fans over the faces, and the faces; of a quad those that it is read as. @param {Shape} shape */
function trianglesOf({ corners, starts }) {
  const faces = starts.length - 1;
  const out = new Uint32Array(3 * (corners.length - 2 * faces));
  /** @type {number[]} */
  const from = [];
  for (let face = 0; face < faces; face++) {
    for (let c = starts[face] + 1; c + 1 < starts[face + 1]; c++) {
      out.set([corners[starts[face]], corners[c], corners[c + 1]], 3 * from.length);
      from.push(face);
    }
  }
  return { corners: out, faces: from };
}

/** The corners of a quad; null where it is flat, or no quad. @param {Shape} shape @param {number} face @returns {Float64Array[] | null} */
function warpedOf({ points, corners, starts }, face) {
  if (starts[face + 1] - starts[face] !== 4) return null;
  const quad = [...corners.subarray(starts[face], starts[face + 1])].map((vertex) => points.subarray(3 * vertex, 3 * vertex + 3));
  return sideOfPlane(quad[0], quad[1], quad[2], quad[3]) === 0 ? null : quad;
}

/** Does a point lie in or on a tetrahedron? @param {Float64Array[]} corners @param {ArrayLike<number>} point */
function isWithin(corners, point) {
  for (let k = 0; k < 3; k++) {
    if (corners.every((corner) => corner[k] < point[k]) || corners.every((corner) => corner[k] > point[k])) return false;
  }
  return corners.every((corner, place) => {
    const [a, b, c] = corners.filter((_, other) => other !== place);
    return sideOfPlane(a, b, c, point) !== -sideOfPlane(a, b, c, corner);
  });
}
