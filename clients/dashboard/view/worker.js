// Fetches and decodes meshes away from the page, and sends them in pieces.

import { FOOT_WIDTH, Meshes } from "../js/meshes.js";
import { Transport } from "../js/transport.js";
import { cloudNormals } from "./cloud.js";
import { patchTint } from "./colours.js";
import { FlatFaces } from "./flat.js";
import { moveVertices } from "./handle.js";
import { cornerValues, drawnTriangles, heatPieces, pointValues, worstError } from "./heat.js";
import { readPly } from "./ply.js";
import { Sides } from "./sides.js";
import { colourCells, fillCells } from "./regions.js";
import { buildPiece, gridSteps, pieces } from "./soup.js";
import { cornerNormals, faceNormals, facesOfVertices, irregularVertices } from "./topology.js";

/** @import { Shape } from "./ply.js" */
/** @import { Refined } from "./refine.js" */
/** @import { Cells, Plan } from "./regions.js" */
/** @import { Frame } from "./soup.js" */
/** @typedef {{ task: number, id: string, token: string | null, frame: Frame, isBilinear: boolean,
 *   wantsPatches: boolean }} LoadRequest */

const CLOUD_PIECE = 131072;

/** @typedef {{ shape: Shape, steps: number, frame: Frame, tints: Uint8Array | null, before?: Float64Array,
 *   cells?: Cells, heat?: { key: string, refined: Refined }, sides?: Sides, working?: Promise<void> }} Kept
 *   heat: the distances from another surface that were asked for last; sides: of the surface itself;
 *   working: what works on the heat */

/** @type {Map<number, Kept>} what may be asked of later, by task */
const kept = new Map();

const post = (/** @type {any} */ message, /** @type {Transferable[]} */ transfer = []) =>
  /** @type {any} */ (self).postMessage(message, transfer);

/** @param {LoadRequest} request */
async function load({ task, id, token, frame, isBilinear, wantsPatches }) {
  const meshes = new Meshes(new Transport({ token }));
  const [{ bytes }, patches] = await Promise.all([
    meshes.content(id, { format: "ply" }), wantsPatches ? meshes.patches(id) : null]);
  const shape = readPly(bytes);
  const faceCount = shape.starts.length - 1;
  if (faceCount === 0) {
    kept.set(task, { shape, steps: 1, frame, tints: null });
    return sendCloud(task, shape, frame);
  }
  let quadCount = 0;
  for (let face = 0; face < faceCount; face++) if (shape.starts[face + 1] - shape.starts[face] === 4) quadCount++;
  const steps = gridSteps(quadCount, isBilinear);
  const around = facesOfVertices(shape);
  const normals = cornerNormals(shape, faceNormals(shape), around);
  const tints = patches && tintFaces(patches, faceCount);
  kept.set(task, { shape, steps, frame, tints });
  for (const run of pieces(shape, steps)) {
    const piece = buildPiece(shape, normals, tints, frame, steps, run);
    post({ task, kind: "piece", ...piece }, [piece.position.buffer, piece.normal.buffer, piece.edge.buffer, piece.tint.buffer]);
  }
  if (quadCount > 0) sendIrregular(task, shape, irregularVertices(shape, around), frame);
  return post({ task, kind: "done" });
}

/** @param {import("../js/types.js").Patches} patches @param {number} faceCount */
function tintFaces({ patches }, faceCount) {
  const tints = new Uint8Array(3 * faceCount).fill(190);
  patches.forEach((patch, place) => {
    const tint = patchTint(place);
    for (const face of patch.faces) tints.set(tint, 3 * face);
  });
  return tints;
}

/** @param {number} task @param {Shape} shape @param {{ vertices: number[], valences: number[] }} found @param {Frame} frame */
function sendIrregular(task, { points }, { vertices, valences }, { centre, scale }) {
  const position = new Float32Array(3 * vertices.length);
  vertices.forEach((vertex, place) => {
    for (let k = 0; k < 3; k++) position[3 * place + k] = (points[3 * vertex + k] - centre[k]) * scale;
  });
  post({ task, kind: "irregular", position, valence: Float32Array.from(valences) });
}

/** Points at once, then their normals. @param {number} task @param {Shape} shape @param {Frame} frame */
function sendCloud(task, { points }, { centre, scale }) {
  const position = new Float32Array(points.length);
  for (let i = 0; i < points.length; i++) position[i] = (points[i] - centre[i % 3]) * scale;
  for (let from = 0; from < position.length; from += 3 * CLOUD_PIECE) {
    const part = position.slice(from, from + 3 * CLOUD_PIECE);
    post({ task, kind: "points", position: part }, [part.buffer]);
  }
  const { normals, spacing } = cloudNormals(position);
  for (let from = 0, place = 0; from < normals.length; from += 4 * CLOUD_PIECE, place++) {
    const normal = normals.slice(from, from + 4 * CLOUD_PIECE);
    post({ task, kind: "normals", place, normal, spacing }, [normal.buffer]);
  }
  post({ task, kind: "done" });
}

/**
 * The triangles of some faces, flat, where they are in the scene's unit.
 * @param {{ task: number, faces: Uint32Array, frame: Frame, request: number }} request
 */
function outline({ task, faces, frame: { centre, scale }, request }) {
  const shape = kept.get(task)?.shape;
  /** @type {number[]} */
  const out = [];
  const put = (/** @type {number} */ corner) => {
    for (let k = 0; k < 3; k++) out.push(((shape?.points[3 * shape.corners[corner] + k] ?? 0) - centre[k]) * scale);
  };
  for (const face of shape ? faces : []) {
    const { starts } = /** @type {Shape} */ (shape);
    for (let k = starts[face] + 1; k + 1 < starts[face + 1]; k++) [starts[face], k, k + 1].forEach(put);
  }
  post({ task, kind: "outline", request, triangles: Float32Array.from(out) });
}

/**
 * Colours a surface by its distance from another one, or a cloud by that of its points: cuts it where the distance is not linear.
 * @param {{ task: number, other: number, id: string, key: string, quads: "triangles" | "bilinear", token: string | null,
 *   isSigned: boolean, target: number, most: number, request: number }} request other, id, key: the other surface, as it is now
 */
async function heat({ task, other, id, key, quads, token, isSigned, target, most, request }) {
  const found = kept.get(task);
  if (!found) return;
  const { shape, steps } = found;
  if (found.heat?.key !== key) found.heat = { key, refined: drawnTriangles(shape, steps) };
  const { refined } = found.heat;
  const meshes = new Meshes(new Transport({ token }));
  const on = kept.get(other)?.shape;
  // Where no more triangles are allowed, to know more of their error is not worth the time.
  const flat = on && on.starts.length > 1 && refined.count < most ? new FlatFaces(on) : null;
  await refined.refine((points) => findFeet(meshes, id, points, quads), {
    target, most, flat, isWanted: () => kept.get(task) === found && found.heat?.refined === refined });
  const about = kept.get(other);
  if (isSigned && about && about.shape.starts.length > 1) about.sides ??= new Sides(about.shape);
  const sides = isSigned && about?.sides ? sidesOf(refined, about.sides) : null;
  sendHeat(task, found, refined, sides);
  const vertices = sides?.slice(0, shape.points.length / 3) ?? null;
  post({ task, kind: "heated", request, error: worstError(refined, sides), triangles: refined.count, sides: vertices });
}

/**
 * How far a point lies from a surface, and on which side.
 * @param {{ task: number, id: string, point: number[], quads: "triangles" | "bilinear", isSigned: boolean, token: string | null, request: number }} request
 */
async function probe({ task, id, point, quads, isSigned, token, request }) {
  const found = kept.get(task);
  if (!found) return;
  const { distance: [distance], foot, face: [face] } = await findFeet(new Meshes(new Transport({ token })), id, Float64Array.from(point), quads);
  if (isSigned && found.shape.starts.length > 1) found.sides ??= new Sides(found.shape);
  post({ task, kind: "probed", request, distance, side: isSigned && found.sides ? found.sides.sideOf(point, foot, face) : 0 });
}

/** Triangles in the place of those that they are parts of; where none was cut, values alone. @param {number} task @param {Kept} found
 * @param {Refined} refined @param {Int8Array | null} sides */
function sendHeat(task, found, refined, sides) {
  const { shape, steps } = found;
  let place = 0;
  post({ task, kind: "new heat" });
  for (const value of shape.starts.length <= 1 ? pointValues(refined, sides, CLOUD_PIECE) : refined.isCut ? [] : cornerValues(shape, steps, refined, sides)) {
    post({ task, kind: "values", place: place++, value }, [value.buffer]);
  }
  if (!refined.isCut) return;
  const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
  for (const piece of heatPieces({ ...found, normals }, refined, sides)) {
    post({ task, kind: "heat", ...piece }, [piece.position.buffer, piece.normal.buffer, piece.edge.buffer, piece.tint.buffer, piece.value.buffer]);
  }
}

/**
 * @param {Meshes} meshes
 * @param {string} id
 * @param {Float64Array<ArrayBuffer>} points
 * @param {"triangles" | "bilinear"} quads
 * @returns {Promise<import("./refine.js").Feet>}
 */
async function findFeet(meshes, id, points, quads) {
  const count = points.length / 3;
  const feet = { distance: new Float64Array(count), foot: new Float64Array(3 * count), face: new Int32Array(count) };
  let point = 0;
  for await (const rows of meshes.project(id, points, { quads })) {
    for (let at = 0; at < rows.length; at += FOOT_WIDTH, point++) {
      feet.distance[point] = rows[at];
      feet.foot.set(rows.subarray(at + 1, at + 4), 3 * point);
      feet.face[point] = rows[at + 4];
    }
  }
  return feet;
}

/** On which side of another surface each point lies. @param {Refined} refined @param {Sides} sides */
function sidesOf({ points, feet: { foot, face } }, sides) {
  return Int8Array.from(face, (on, point) => sides.sideOf([...points.subarray(3 * point, 3 * point + 3)], foot.subarray(3 * point, 3 * point + 3), on));
}

/** Which part of the surface lies in which patch. @param {{ task: number, plan: Plan, request: number }} request */
function regions({ task, plan, request }) {
  const found = kept.get(task);
  if (!found) return;
  found.cells ??= fillCells(found.shape, found.frame);
  const coloured = colourCells(found.cells, found.frame, plan);
  post({ task, kind: "regions", request, ...coloured }, [coloured.colours.buffer]);
}

/**
 * Moves the vertices within a radius of a point, less the farther they are; sends their positions and the pieces again.
 * @param {{ task: number, centre: number[], radius: number, offset: number[], request: number, starts: boolean }} request
 *   starts: from where the vertices are now
 */
function deform({ task, centre, radius, offset, request, starts: isStart }) {
  const found = kept.get(task);
  if (!found) return;
  const { points } = found.shape;
  if (isStart || !found.before) found.before = points.slice();
  const { indices, positions } = moveVertices(found.before, centre, radius, offset);
  indices.forEach((vertex, place) => points.set(positions[place], 3 * vertex));
  found.heat = found.sides = undefined; // of what it was
  post({ task, kind: "deformed", request, indices, positions });
  rebuild(task, new Set(indices));
}

/** Sends the pieces again that have one of the vertices. @param {number} task @param {Set<number>} moved */
function rebuild(task, moved) {
  const { shape, steps, frame, tints } = /** @type {Kept} */ (kept.get(task));
  const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
  let place = 0;
  for (const run of pieces(shape, steps)) {
    const corners = shape.corners.subarray(shape.starts[run.from], shape.starts[run.to]);
    if (corners.some((vertex) => moved.has(vertex))) {
      const piece = buildPiece(shape, normals, tints, frame, steps, run);
      post({ task, kind: "moved", place, position: piece.position, normal: piece.normal }, [piece.position.buffer, piece.normal.buffer]);
    }
    place++;
  }
}

self.addEventListener("message", ({ data }) => {
  if (data.kind === "load") {
    load(data).catch((error) => post({ task: data.task, kind: "fault", words: error.message }));
  } else if (data.kind === "outline") {
    outline(data);
  } else if (data.kind === "heat") {
    const found = kept.get(data.task);
    if (!found) return;
    found.working = (found.working ?? Promise.resolve()).then(() => heat(data)).catch((error) => post({ task: data.task, kind: "heated", request: data.request, words: error.message }));
  } else if (data.kind === "probe") {
    probe(data).catch((error) => post({ task: data.task, kind: "probed", request: data.request, words: error.message }));
  } else if (data.kind === "regions") {
    regions(data);
  } else if (data.kind === "deform") {
    deform(data);
  } else if (data.kind === "forget") {
    kept.delete(data.task);
  }
});
