// The page's side of the worker: fills models, and paints them with values.

import { client } from "../core/connection.js";

/** @import { Model } from "./model.js" */
/** @typedef {{ model: Model, onPiece: () => void, resolve: () => void, reject: (error: Error) => void }} Task */

/** @type {Worker | undefined} */
let worker;
/** @type {Map<number, Task>} */
const tasks = new Map();
/** @type {Map<number, () => void>} */
const paintings = new Map();
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
  if (data.kind === "painted") {
    paintings.get(data.task)?.();
    paintings.delete(data.task);
  }
  if (!task) return;
  const { model } = task;
  if (data.kind === "piece") model.addPiece(data);
  else if (data.kind === "points") model.addPoints(data.position);
  else if (data.kind === "normals") model.setNormals(data.place, data.normal, data.spacing);
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
  const { mesh, frame, isBilinear } = model;
  (worker ?? start()).postMessage({
    kind: "load", task, id: mesh.id, token: client.transport.token, frame, isBilinear, wantsPatches: mesh.patches > 0,
  });
  return new Promise((resolve, reject) => { tasks.set(task, { model, onPiece, resolve, reject }); });
}

/**
 * Gives the corners of a whole model the values of its vertices.
 * @param {Model} model
 * @param {Float64Array} values in the order of the file
 * @returns {Promise<void>}
 */
export function paint(model, values) {
  const task = /** @type {number} */ (taskOf.get(model));
  return new Promise((resolve) => {
    paintings.set(task, resolve);
    worker?.postMessage({ kind: "paint", task, values });
  });
}

/** @param {Model} model */
export function forget(model) {
  const task = taskOf.get(model);
  if (task === undefined) return;
  tasks.delete(task);
  worker?.postMessage({ kind: "forget", task });
}
