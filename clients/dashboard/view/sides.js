// On which side of a surface points lie: the sign of the way from the foot to the point along the surface's normal there. At
// edges and vertices that is the mean normal of the faces, each by its angle (Baerentzen and Aanaes 2005), which alone tells
// inside from outside for certain.

import { faceNormals, facesOfVertices } from "./topology.js";

/** @import { Shape } from "./ply.js" */

/** How near to an edge a foot counts as on it, as a share of the face's size. */
const ON_EDGE = 1e-6;

export class Sides {
  /** @param {Shape} shape of a surface whose faces agree about which side is out */
  constructor(shape) {
    this.shape = shape;
    this.normals = faceNormals(shape);
    this.around = facesOfVertices(shape);
    for (let at = 0; at < this.normals.length; at += 3) {
      const size = Math.hypot(this.normals[at], this.normals[at + 1], this.normals[at + 2]) || 1;
      for (let k = 0; k < 3; k++) this.normals[at + k] /= size;
    }
  }

  /** @param {number} vertex @param {number} k */
  at(vertex, k) {
    return this.shape.points[3 * vertex + k];
  }

  /**
   * @param {number[]} point
   * @param {ArrayLike<number>} foot the nearest place of the surface
   * @param {number} face that it lies on
   * @returns {1 | -1} 1: outside, or on the surface
   */
  sideOf(point, foot, face) {
    const normal = this.normalAt(foot, face);
    return normal.reduce((sum, value, k) => sum + value * (point[k] - foot[k]), 0) < 0 ? -1 : 1;
  }

  /** @param {ArrayLike<number>} foot @param {number} face */
  normalAt(foot, face) {
    const { starts, corners } = this.shape;
    const [first, end] = [starts[face], starts[face + 1]];
    let size = 0;
    for (let k = 0; k < 3; k++) size = Math.max(size, Math.abs(this.at(corners[first], k) - this.at(corners[first + 1], k)), Math.abs(this.at(corners[first + 1], k) - this.at(corners[first + 2], k)));
    const near = ON_EDGE * size;
    for (let c = first; c < end; c++) {
      if (Math.hypot(...[0, 1, 2].map((k) => foot[k] - this.at(corners[c], k))) <= near) return this.normalOfVertex(corners[c]);
    }
    for (let c = first; c < end; c++) {
      const next = corners[c + 1 === end ? first : c + 1];
      if (this.isOnEdge(foot, corners[c], next, near)) return this.normalOfEdge(corners[c], next);
    }
    return [0, 1, 2].map((k) => this.normals[3 * face + k]);
  }

  /** @param {ArrayLike<number>} foot @param {number} a @param {number} b @param {number} near */
  isOnEdge(foot, a, b, near) {
    const along = [0, 1, 2].map((k) => this.at(b, k) - this.at(a, k));
    const from = [0, 1, 2].map((k) => foot[k] - this.at(a, k));
    const share = along.reduce((sum, value, k) => sum + value * from[k], 0) / (along.reduce((sum, value) => sum + value * value, 0) || 1);
    return share > 0 && share < 1 && Math.hypot(...from.map((value, k) => value - share * along[k])) <= near;
  }

  /** @param {number} a @param {number} b */
  normalOfEdge(a, b) {
    const others = new Set(this.facesAt(b));
    return this.sum(this.facesAt(a).filter((face) => others.has(face)), () => 1);
  }

  /** @param {number} vertex */
  normalOfVertex(vertex) {
    return this.sum(this.facesAt(vertex), (face) => this.angleAt(face, vertex));
  }

  /** @param {number} vertex */
  facesAt(vertex) {
    const { first, faces } = this.around;
    return [...faces.subarray(first[vertex], first[vertex + 1])];
  }

  /** @param {number[]} faces @param {(face: number) => number} weight */
  sum(faces, weight) {
    const total = [0, 0, 0];
    for (const face of faces) for (let k = 0; k < 3; k++) total[k] += weight(face) * this.normals[3 * face + k];
    return total;
  }

  /** The angle of a face at one of its corners. @param {number} face @param {number} vertex */
  angleAt(face, vertex) {
    const { starts, corners } = this.shape;
    const all = corners.subarray(starts[face], starts[face + 1]);
    const place = all.indexOf(vertex);
    const ways = [all[(place + 1) % all.length], all[(place + all.length - 1) % all.length]].map((other) => [0, 1, 2].map((k) => this.at(other, k) - this.at(vertex, k)));
    const [u, v] = ways;
    const cosine = (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / (Math.hypot(...u) * Math.hypot(...v) || 1);
    return Math.acos(Math.max(-1, Math.min(1, cosine)));
  }
}
