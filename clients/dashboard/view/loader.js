// The page's side of the worker: fills models, and asks about them.

import { client } from "../core/connection.js";

/** @import { Model } from "./model.js" */
/** @import { Telling } from "./against.js" */
/** @import { Plan } from "./regions.js" */
/** @typedef {{ model: Model, onPiece: () => void, resolve: () => void, reject: (error: Error) => void }} Task */

/** @type {Worker | undefined} */
let worker;
/** @type {Map<number, Task>} */
const tasks = new Map();
/** Answers to single questions, by number. @type {Map<number, (data: any) => void>} */
const answers = new Map();
let nextRequest = 1;
/** @type {WeakMap<Model, number>} */
const taskOf = new WeakMap();
let nextTask = 1;

function start() {
  worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  worker.addEventListener("message", ({ data }) => receive(data));
  worker.addEventListener("error", () => {
    for (const { reject } of tasks.values()) reject(new Error("the 3D view's worker could not be started"));
    tasks.clear();
  });
  return worker;
}

/** @param {any} data */
function receive(data) {
  const task = tasks.get(data.task);
  if (data.request !== undefined) {
    answers.get(data.request)?.(data);
    answers.delete(data.request);
  }
  if (!task) return;
  const { model } = task;
  if (data.kind === "piece") model.addPiece(data);
  else if (data.kind === "points") model.addPoints(data.position);
  else if (data.kind === "normals") model.setNormals(data.place, data.normal, data.spacing);
  else if (data.kind === "moved") model.movePiece(data.place, data.position, data.normal);
  else if (data.kind === "new heat") model.dropHeat();
  else if (data.kind === "heat") model.addHeat(data);
  else if (data.kind === "values") model.setValues(data.place, data.value);
  else if (data.kind === "irregular") model.setIrregular(data.position, data.valence);
  else if (data.kind === "fault") task.reject(new Error(data.words));
  else if (data.kind === "done") {
    model.isWhole = true;
    task.resolve();
  }
  task.onPiece();
}

/**
 * Fills a model; resolves when it is whole.
 * @param {Model} model
 * @param {() => void} onPiece called after each change
 * @returns {Promise<void>}
 */
export function load(model, onPiece) {
  const task = nextTask++;
  taskOf.set(model, task);
  const { mesh, frame, isBilinear, transform } = model;
  (worker ?? start()).postMessage({
    kind: "load", task, id: mesh.id, token: client.transport.token, frame, isBilinear, transform, wantsPatches: mesh.patches > 0,
  });
  return new Promise((resolve, reject) => { tasks.set(task, { model, onPiece, resolve, reject }); });
}

/**
 * @param {Model} model
 * @param {Record<string, unknown>} question
 * @returns {Promise<any>}
 */
function ask(model, question) {
  const request = nextRequest++;
  worker?.postMessage({ ...question, task: taskOf.get(model), request });
  return new Promise((resolve) => { answers.set(request, resolve); });
}

/**
 * The triangles of some faces of a whole model.
 * @param {Model} model
 * @param {Iterable<number>} faces
 * @param {{ centre: number[], scale: number }} frame of the scene
 * @returns {Promise<Float32Array>}
 */
export async function outline(model, faces, frame) {
  return (await ask(model, { kind: "outline", faces: Uint32Array.from(faces), frame })).triangles;
}

/** As many triangles as a view of a common size has use for. */
const MOST_TRIANGLES = 250000;

/**
 * Colours a whole model by its distance from another whole one.
 * @param {Model} model
 * @param {Model} other
 * @param {{ quads: "triangles" | "bilinear", telling: Telling, target: number }} options target: the error that is small enough
 * @returns {Promise<{ error: number, triangles: number, sides: Int8Array | null }>} error: how far the colours may be off between
 *   vertices; sides of the file's vertices: 1 outside, -1 inside, 0 on the other one or not known
 */
export async function heat(model, other, { quads, telling, target }) {
  const { id, revision } = other.mesh;
  const { error, triangles, sides, words } = await ask(model, {
    kind: "heat", other: taskOf.get(other), id, key: `${id} ${revision} ${quads}`, quads, token: client.transport.token, telling, target, most: MOST_TRIANGLES });
  if (words) throw new Error(words);
  return { error, triangles, sides };
}

/**
 * The distance of a point from a whole model.
 * @param {Model} other
 * @param {number[]} point
 * @param {"triangles" | "bilinear"} quads
 * @param {Telling} telling
 * @returns {Promise<{ distance: number, side: number }>} side: 1 outside, -1 inside, 0 not asked for or not known
 */
export async function probe(other, point, quads, telling) {
  const { distance, side, words } = await ask(other, { kind: "probe", id: other.mesh.id, point, quads, telling, token: client.transport.token });
  if (words) throw new Error(words);
  return { distance, side };
}

/**
 * Colours the parts of a whole model that lie in the patches of a layout.
 * @param {Model} model
 * @param {Plan} plan
 */
export async function colourRegions(model, plan) {
  model.setRegions(await ask(model, { kind: "regions", plan }));
}

/**
 * Moves the vertices near a point of a whole model, on the screen; the daemon is told by who asked.
 * @param {Model} model
 * @param {{ centre: number[], radius: number, offset: number[], starts: boolean }} handle
 * @returns {Promise<{ indices: number[], positions: [number, number, number][] }>} where they are now
 */
export async function moveNear(model, handle) {
  const { indices, positions } = await ask(model, { kind: "deform", ...handle });
  return { indices, positions };
}

/** @param {Model} model */
export function forget(model) {
  const task = taskOf.get(model);
  if (task === undefined) return;
  tasks.delete(task);
  worker?.postMessage({ kind: "forget", task });
}
