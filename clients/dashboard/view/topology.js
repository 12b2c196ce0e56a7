// Faces round vertices: normals that keep creases, and the irregular vertices of quad meshes.

/** @import { Shape } from "./ply.js" */

const CREASE_COSINE = Math.cos((40 * Math.PI) / 180);

/**
 * Area-weighted normals of the faces, by Newell's sums over their corners (Sutherland, Sproull, Schumacker 1974).
 * @param {Shape} shape
 */
export function faceNormals({ points, corners, starts }) {
  const count = starts.length - 1;
  const normals = new Float32Array(3 * count);
  const origin = points.subarray(0, 3); // sums of large coordinates would cancel
  for (let face = 0; face < count; face++) {
    let x = 0, y = 0, z = 0;
    for (let k = starts[face], last = starts[face + 1] - 1; k <= last; k++) {
      const p = 3 * corners[k];
      const q = 3 * corners[k === last ? starts[face] : k + 1];
      const px = points[p] - origin[0], py = points[p + 1] - origin[1], pz = points[p + 2] - origin[2];
      const qx = points[q] - origin[0], qy = points[q + 1] - origin[1], qz = points[q + 2] - origin[2];
      x += py * qz - pz * qy;
      y += pz * qx - px * qz;
      z += px * qy - py * qx;
    }
    normals.set([x, y, z], 3 * face);
  }
  return normals;
}

/**
 * The faces round each vertex, one after the other.
 * @param {Shape} shape
 */
export function facesOfVertices({ points, corners, starts }) {
  const first = new Uint32Array(points.length / 3 + 1);
  for (const vertex of corners) first[vertex + 1]++;
  for (let v = 1; v < first.length; v++) first[v] += first[v - 1];
  const faces = new Uint32Array(corners.length);
  const next = first.slice();
  for (let face = 0; face + 1 < starts.length; face++) {
    for (let k = starts[face]; k < starts[face + 1]; k++) faces[next[corners[k]]++] = face;
  }
  return { first, faces };
}

/**
 * For each corner of each face the mean normal of the faces round its vertex that bend away by less than a crease.
 * @param {Shape} shape
 * @param {Float32Array} normals of the faces
 * @param {{ first: Uint32Array, faces: Uint32Array }} around
 * @returns {Float32Array} rows of x, y, z, a corner each, of length 1
 */
export function cornerNormals({ corners, starts }, normals, { first, faces }) {
  const sizes = new Float32Array(normals.length / 3);
  for (let face = 0; face < sizes.length; face++) {
    sizes[face] = Math.hypot(normals[3 * face], normals[3 * face + 1], normals[3 * face + 2]);
  }
  const out = new Float32Array(3 * corners.length);
  for (let face = 0; face < sizes.length; face++) {
    const nx = normals[3 * face], ny = normals[3 * face + 1], nz = normals[3 * face + 2];
    for (let k = starts[face]; k < starts[face + 1]; k++) {
      let x = 0, y = 0, z = 0;
      for (let i = first[corners[k]]; i < first[corners[k] + 1]; i++) {
        const other = faces[i];
        const mx = normals[3 * other], my = normals[3 * other + 1], mz = normals[3 * other + 2];
        if (nx * mx + ny * my + nz * mz < CREASE_COSINE * sizes[face] * sizes[other]) continue;
        x += mx;
        y += my;
        z += mz;
      }
      const size = Math.sqrt(x * x + y * y + z * z) || 1;
      out[3 * k] = x / size;
      out[3 * k + 1] = y / size;
      out[3 * k + 2] = z / size;
    }
  }
  return out;
}

/**
 * Inner vertices of quads only whose valence is not four, as the daemon counts them.
 * @param {Shape} shape
 * @param {{ first: Uint32Array, faces: Uint32Array }} around
 * @returns {{ vertices: number[], valences: number[] }}
 */
export function irregularVertices({ corners, starts }, { first, faces }) {
  /** @type {number[]} */
  const vertices = [];
  /** @type {number[]} */
  const valences = [];
  for (let vertex = 0; vertex + 1 < first.length; vertex++) {
    const valence = first[vertex + 1] - first[vertex];
    if (valence === 4 || valence < 2) continue;
    /** @type {Map<number, number>} how many of the faces have the edge to each neighbour */
    const edges = new Map();
    let isQuads = true;
    for (let i = first[vertex]; i < first[vertex + 1] && isQuads; i++) {
      const start = starts[faces[i]];
      isQuads = starts[faces[i] + 1] - start === 4;
      if (!isQuads) break;
      const place = [0, 1, 2, 3].find((k) => corners[start + k] === vertex) ?? 0;
      for (const neighbour of [corners[start + ((place + 1) & 3)], corners[start + ((place + 3) & 3)]]) {
        edges.set(neighbour, (edges.get(neighbour) ?? 0) + 1);
      }
    }
    if (!isQuads || [...edges.values()].some((uses) => uses !== 2)) continue;
    vertices.push(vertex);
    valences.push(valence);
  }
  return { vertices, valences };
}
