// Fetches and decodes meshes away from the page, and sends them in pieces.

import { Meshes } from "../js/meshes.js";
import { Transport } from "../js/transport.js";
import { patchTint } from "./colours.js";
import { readPly } from "./ply.js";
import { buildPiece, gridSteps, pieces } from "./soup.js";
import { cornerNormals, faceNormals, facesOfVertices, irregularVertices } from "./topology.js";
import { movePoints } from "./transform.js";

/** @import { Transform } from "../js/types.js" */
/** @import { Against } from "./against.js" */
/** @import { Shape } from "./ply.js" */
/** @import { Cells, Plan } from "./regions.js" */
/** @import { Frame } from "./soup.js" */
/** @typedef {{ task: number, id: string, token: string | null, frame: Frame, isBilinear: boolean, transform: Transform | null,
 *   wantsPatches: boolean }} LoadRequest */

/** @typedef {{ shape: Shape, steps: number, frame: Frame, tints: Uint8Array | null, before?: Float64Array,
 *   cells?: Cells, against?: Against }} Kept against: another surface that its distance was asked from */

/** @type {Map<number, Kept>} what may be asked of later, by task */
const kept = new Map();

const post = (/** @type {any} */ message, /** @type {Transferable[]} */ transfer = []) =>
  /** @type {any} */ (self).postMessage(message, transfer);

/** @param {LoadRequest} request */
async function load({ task, id, token, frame, isBilinear, transform, wantsPatches }) {
  const meshes = new Meshes(new Transport({ token }));
  const [{ bytes }, patches] = await Promise.all([
    meshes.content(id, { format: "ply" }), wantsPatches ? meshes.patches(id) : null]);
  const shape = readPly(bytes);
  if (transform) movePoints(transform, shape.points);
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

/** Points at once, then their normals, by a module that is fetched for them. @param {number} task @param {Shape} shape @param {Frame} frame */
async function sendCloud(task, { points }, { centre, scale }) {
  const { CLOUD_PIECE, cloudNormals } = await import("./cloud.js");
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

/** Distances between surfaces, by a module that is fetched when they are wanted. @param {any} data */
async function measure(data) {
  const found = kept.get(data.task);
  const { Against, probe } = await import("./against.js");
  if (!found || kept.get(data.task) !== found) return post({ kind: "measured", request: data.request, words: "the mesh is not shown any more" });
  const meshes = new Meshes(new Transport({ token: data.token }));
  if (data.kind === "probe") return post({ kind: "measured", request: data.request, ...await probe(meshes, found, data) });
  found.against ??= new Against(found, (message, transfer) => post({ task: data.task, ...message }, transfer), () => kept.get(data.task) === found);
  return post({ kind: "measured", request: data.request, ...await found.against.colour(meshes, kept.get(data.other), data) });
}

/** Which part of the surface lies in which patch. @param {{ task: number, plan: Plan, request: number }} request */
async function regions({ task, plan, request }) {
  const found = kept.get(task);
  const { colourCells, fillCells } = await import("./regions.js");
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
async function deform({ task, centre, radius, offset, request, starts: isStart }) {
  const { moveVertices } = await import("./handle.js");
  const found = kept.get(task);
  if (!found) return;
  const { points } = found.shape;
  if (isStart || !found.before) found.before = points.slice();
  const { indices, positions } = moveVertices(found.before, centre, radius, offset);
  indices.forEach((vertex, place) => points.set(positions[place], 3 * vertex));
  kept.set(task, { ...found, against: undefined }); // what was computed of it holds no more
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
  } else if (data.kind === "heat" || data.kind === "probe") {
    measure(data).catch((error) => post({ task: data.task, kind: "measured", request: data.request, words: error.message }));
  } else if (data.kind === "regions") {
    regions(data);
  } else if (data.kind === "deform") {
    deform(data);
  } else if (data.kind === "forget") {
    kept.delete(data.task);
  }
});
