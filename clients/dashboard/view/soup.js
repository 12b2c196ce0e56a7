// Faces as triangles for the graphics card, in pieces of bounded size: positions, normals, edges to draw, patch colours. A quad is two triangles, or, read as a bilinear patch, a grid of them.

/** @import { Shape } from "./ply.js" */
/** @typedef {{ centre: number[], scale: number }} Frame positions are (point - centre) * scale */
/** @typedef {{ position: Float32Array, normal: Int8Array, edge: Uint8Array, tint: Uint8Array }} Piece */

export const PIECE_TRIANGLES = 50000;
const BILINEAR_TRIANGLES = 800000;

/**
 * How many steps a side of a quad is cut into, so that all of them stay within a budget.
 * @param {number} quadCount
 * @param {boolean} isBilinear
 */
export function gridSteps(quadCount, isBilinear) {
  if (!isBilinear || quadCount === 0) return 1;
  return Math.max(2, Math.min(8, Math.floor(Math.sqrt(BILINEAR_TRIANGLES / (2 * quadCount)))));
}

/** @param {number} cornerCount @param {number} steps */
const trianglesOf = (cornerCount, steps) => (cornerCount === 4 && steps > 1 ? 2 * steps * steps : Math.max(0, cornerCount - 2));

/**
 * The faces of each piece, as [from, to) and the number of triangles.
 * @param {Shape} shape
 * @param {number} steps
 */
export function* pieces({ starts }, steps) {
  let from = 0;
  let triangles = 0;
  for (let face = 0; face + 1 < starts.length; face++) {
    triangles += trianglesOf(starts[face + 1] - starts[face], steps);
    if (triangles < PIECE_TRIANGLES && face + 2 < starts.length) continue;
    yield { from, to: face + 1, triangles };
    from = face + 1;
    triangles = 0;
  }
}

/**
 * Walks the triangles of a run of faces. A corner of a triangle is a mixture of the face's corners i0..i3 (places in
 * `corners`) by weights w0..w3; `shown` has a bit for each edge of the triangle, opposite to its corner, that is one of
 * the face.
 * @param {Shape} shape
 * @param {number} steps
 * @param {number} from
 * @param {number} to
 * @param {(face: number, corner: number, shown: number, i0: number, i1: number, i2: number, i3: number, w0: number,
 *   w1: number, w2: number, w3: number) => void} visit called three times for each triangle
 */
export function walk({ starts }, steps, from, to, visit) {
  for (let face = from; face < to; face++) {
    const s = starts[face];
    const count = starts[face + 1] - s;
    if (count === 4 && steps > 1) {
      walkGrid(face, s, steps, visit);
      continue;
    }
    for (let k = 1; k + 1 < count; k++) {
      // The edge opposite to the first corner is the face's; the others only in the first and last triangle.
      const shown = 1 | (k + 2 === count ? 2 : 0) | (k === 1 ? 4 : 0);
      visit(face, 0, shown, s, s, s, s, 1, 0, 0, 0);
      visit(face, 1, shown, s + k, s, s, s, 1, 0, 0, 0);
      visit(face, 2, shown, s + k + 1, s, s, s, 1, 0, 0, 0);
    }
  }
}

/** @param {number} face @param {number} s @param {number} steps @param {Parameters<typeof walk>[4]} visit */
function walkGrid(face, s, steps, visit) {
  const at = (/** @type {number} */ corner, /** @type {number} */ shown, /** @type {number} */ i, /** @type {number} */ j) => {
    const u = i / steps;
    const v = j / steps;
    visit(face, corner, shown, s, s + 1, s + 2, s + 3, (1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v);
  };
  for (let i = 0; i < steps; i++) {
    for (let j = 0; j < steps; j++) {
      const lower = (i + 1 === steps ? 1 : 0) | (j === 0 ? 4 : 0);
      at(0, lower, i, j);
      at(1, lower, i + 1, j);
      at(2, lower, i + 1, j + 1);
      const upper = (j + 1 === steps ? 1 : 0) | (i === 0 ? 2 : 0);
      at(0, upper, i, j);
      at(1, upper, i + 1, j + 1);
      at(2, upper, i, j + 1);
    }
  }
}

/**
 * @param {Shape} shape
 * @param {Float32Array} normals of the corners
 * @param {Uint8Array | null} tints rows of r, g, b, a face each
 * @param {Frame} frame
 * @param {number} steps
 * @param {{ from: number, to: number, triangles: number }} run
 * @returns {Piece}
 */
export function buildPiece(shape, normals, tints, { centre, scale }, steps, { from, to, triangles }) {
  const { points, corners } = shape;
  const position = new Float32Array(9 * triangles);
  const normal = new Int8Array(12 * triangles);
  const edge = new Uint8Array(12 * triangles);
  const tint = new Uint8Array(12 * triangles);
  let n = 0;
  walk(shape, steps, from, to, (face, corner, shown, i0, i1, i2, i3, w0, w1, w2, w3) => {
    const p0 = 3 * corners[i0], p1 = 3 * corners[i1], p2 = 3 * corners[i2], p3 = 3 * corners[i3];
    for (let k = 0; k < 3; k++) {
      position[3 * n + k] = (w0 * (points[p0 + k] - centre[k]) + w1 * (points[p1 + k] - centre[k])
        + w2 * (points[p2 + k] - centre[k]) + w3 * (points[p3 + k] - centre[k])) * scale;
      normal[4 * n + k] = 127 * (w0 * normals[3 * i0 + k] + w1 * normals[3 * i1 + k] + w2 * normals[3 * i2 + k]
        + w3 * normals[3 * i3 + k]);
      // The distance to an edge that is not drawn is made to look large.
      edge[4 * n + k] = corner === k || !(shown & (1 << k)) ? 255 : 0;
      if (tints) tint[4 * n + k] = tints[3 * face + k];
    }
    n++;
  });
  return { position, normal, edge, tint };
}
