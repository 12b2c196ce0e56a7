// A surface in triangles that are small where its distance from another one changes, as pieces for the graphics card.

import { Refined } from "./refine.js";
import { PIECE_TRIANGLES, buildPiece, pieces, walk } from "./soup.js";

/** @import { Shape } from "./ply.js" */
/** @import { Frame } from "./soup.js" */
/** @typedef {{ position: Float32Array, normal: Int8Array, edge: Uint16Array, tint: Uint8Array, value: Float32Array }} HeatPiece
 *   value: distance, negative inside, and how far it may be off over the triangle */

/**
 * The triangles that a surface is drawn with. The points are those of the file, then those within quads.
 * @param {Shape} shape
 * @param {number} steps
 */
export function drawnTriangles(shape, steps) {
  const faces = shape.starts.length - 1;
  let count = 0;
  for (const { triangles } of pieces(shape, steps)) count += triangles;
  const corners = new Uint32Array(3 * count);
  /** @type {number[]} */
  const added = [];
  const known = shape.points.length;
  let n = 0;
  walk(shape, steps, 0, faces, (_face, _corner, _shown, i0, i1, i2, i3, w0, w1, w2, w3) => {
    const weights = [w0, w1, w2, w3];
    const places = [i0, i1, i2, i3].map((place) => 3 * shape.corners[place]);
    const whole = weights.indexOf(1);
    corners[n++] = whole >= 0 ? places[whole] / 3 : (known + added.length) / 3;
    if (whole >= 0) return;
    for (let k = 0; k < 3; k++) added.push(weights.reduce((sum, weight, w) => sum + weight * shape.points[places[w] + k], 0));
  });
  const points = new Float64Array(known + added.length);
  points.set(shape.points);
  points.set(added, known);
  return new Refined(points, corners);
}

/**
 * Pieces of bounded size, in the order of the faces.
 * @param {{ shape: Shape, steps: number, frame: Frame, tints: Uint8Array | null, normals: Float32Array }} drawn
 * @param {Refined} refined
 * @param {Int8Array | null} sides of the points: 1 outside, -1 inside, 0 neither for certain
 * @returns {Generator<HeatPiece>}
 */
export function* heatPieces({ shape, steps, frame, tints, normals }, refined, sides) {
  const signs = signsOf(refined, sides);
  let first = 0;
  let from = 0;
  for (const run of pieces(shape, steps)) {
    const base = buildPiece(shape, normals, tints, frame, steps, run);
    const end = first + run.triangles;
    while (from < refined.count && refined.origins[from] < end) {
      let to = from;
      while (to < refined.count && to - from < PIECE_TRIANGLES && refined.origins[to] < end) to++;
      yield buildHeat(base, first, refined, from, to, frame, signs);
      from = to;
    }
    first = end;
  }
}

/**
 * @param {import("./soup.js").Piece} base the triangles that were cut
 * @param {number} first the number of the first one of them
 * @param {Refined} refined
 * @param {number} from
 * @param {number} to
 * @param {Frame} frame
 * @param {Signs | null} signs
 * @returns {HeatPiece}
 */
function buildHeat(base, first, refined, from, to, { centre, scale }, signs) {
  const count = 3 * (to - from);
  const piece = {
    position: new Float32Array(3 * count), normal: new Int8Array(4 * count), edge: new Uint16Array(4 * count),
    tint: new Uint8Array(4 * count), value: new Float32Array(2 * count) };
  for (let n = 0; n < count; n++) {
    const corner = 3 * from + n;
    const vertex = refined.corners[corner];
    const at = 12 * (refined.origins[Math.floor(corner / 3)] - first);
    const [second, third] = refined.places.subarray(2 * corner, 2 * corner + 2);
    for (let k = 0; k < 3; k++) {
      const mixed = (/** @type {Int8Array | Uint8Array} */ of) => (1 - second - third) * of[at + k] + second * of[at + 4 + k] + third * of[at + 8 + k];
      piece.position[3 * n + k] = (refined.points[3 * vertex + k] - centre[k]) * scale;
      piece.normal[4 * n + k] = mixed(base.normal);
      piece.edge[4 * n + k] = 257 * mixed(base.edge);
      piece.tint[4 * n + k] = base.tint[at + k];
    }
    piece.value[2 * n] = valueOf(refined, vertex, signs && signs.sides);
    piece.value[2 * n + 1] = errorOf(refined, Math.floor(corner / 3), signs);
  }
  return piece;
}

/** What it takes to know the error of signed distances. @typedef {{ sides: Int8Array, slack: number }} Signs sides: 1 outside, -1 inside, 0 neither for certain */

/** @param {Refined} refined @param {Int8Array | null} sides @returns {Signs | null} */
const signsOf = (refined, sides) => sides && { sides, slack: refined.slack };

/** How far what is shown over a triangle may be off. @param {Refined} refined @param {number} t @param {Signs | null} signs */
function errorOf(refined, t, signs) {
  if (!signs) return refined.errors[t];
  const { sides, slack } = signs;
  const corners = [...refined.corners.subarray(3 * t, 3 * t + 3)];
  if (corners.some((vertex) => sides[vertex] === 0 && refined.feet.distance[vertex] > slack)) return refined.eitherErrorOf(t);
  // Normals may tell apart what is surely on one side.
  const isOne = sides[corners[0]] === sides[corners[1]] && sides[corners[1]] === sides[corners[2]];
  return isOne ? refined.signedErrorOf(t, slack) : Math.min(refined.reachOf(t), refined.eitherErrorOf(t));
}

/**
 * For each piece of a surface of which no triangle was cut the values at its corners.
 * @param {Shape} shape @param {number} steps @param {Refined} refined @param {Int8Array | null} sides
 */
export function* cornerValues(shape, steps, refined, sides) {
  let first = 0;
  const signs = signsOf(refined, sides);
  for (const { triangles } of pieces(shape, steps)) {
    yield Float32Array.from({ length: 6 * triangles }, (_, n) => {
      const corner = 3 * first + (n >> 1);
      return n % 2 === 0 ? valueOf(refined, refined.corners[corner], sides) : errorOf(refined, Math.floor(corner / 3), signs);
    });
    first += triangles;
  }
}

/** The values of a cloud's points, of which each is all there is. @param {Refined} refined @param {Int8Array | null} sides @param {number} size */
export function* pointValues(refined, sides, size) {
  const count = refined.points.length / 3;
  for (let from = 0; from < count; from += size) {
    yield Float32Array.from({ length: 2 * Math.min(size, count - from) }, (_, n) => (n % 2 === 0 ? valueOf(refined, from + (n >> 1), sides) : pointError(refined, from + (n >> 1), sides)));
  }
}

/** A point whose side is not known is either. @param {Refined} refined @param {number} vertex @param {Int8Array | null} sides */
const pointError = (refined, vertex, sides) => (sides && sides[vertex] === 0 ? refined.feet.distance[vertex] : 0);

/** @param {Refined} refined @param {number} vertex @param {Int8Array | null} sides */
const valueOf = (refined, vertex, sides) => refined.feet.distance[vertex] * (sides ? sides[vertex] : 1);

/** The greatest error of all that is drawn. @param {Refined} refined @param {Int8Array | null} sides */
export function worstError(refined, sides) {
  let worst = 0;
  const signs = signsOf(refined, sides);
  for (let t = 0; t < refined.count; t++) worst = Math.max(worst, errorOf(refined, t, signs));
  return worst;
}
