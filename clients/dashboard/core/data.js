// Reads the lists of meshes and jobs, and keeps them fresh.

import { client, noteLoss } from "./connection.js";
import { sayFault } from "./messages.js";
import { changed, on, state } from "./state.js";

/** @import { Job } from "../js/types.js" */

const REFRESH_MS = 1500;

/** @template T @param {AsyncIterable<T>} iterator */
async function collect(iterator) {
  /** @type {T[]} */
  const all = [];
  for await (const item of iterator) all.push(item);
  return all;
}

/** @param {unknown} error */
function note(error) {
  noteLoss(error);
  if (state.connection === "open") sayFault(error);
}

export async function refreshMeshes() {
  try {
    state.meshes = await collect(client.meshes.list({ pageSize: 1000 }));
    state.hasMeshes = true;
    for (const side of /** @type {const} */ (["a", "b", "shown"])) {
      if (state[side] !== null && !state.meshes.some((mesh) => mesh.id === state[side])) state[side] = null;
    }
    changed("meshes", "choice");
  } catch (error) {
    note(error);
  }
}

export async function refreshJobs() {
  try {
    state.jobs = (await collect(client.jobs.list({ pageSize: 1000 }))).reverse();
    state.hasJobs = true;
    changed("jobs");
  } catch (error) {
    note(error);
  }
}

/** @param {Job} job */
export const isOpen = (job) => job.state === "queued" || job.state === "running";

/** While jobs run, or their list is looked at, it is read again and again. */
async function watch() {
  const wanted = state.page === "jobs" || state.jobs.some(isOpen);
  if (wanted && state.connection === "open" && document.visibilityState === "visible") await refreshJobs();
  setTimeout(watch, REFRESH_MS);
}

export function startData() {
  on("connection", () => {
    if (state.connection !== "open") return;
    refreshMeshes();
    refreshJobs();
  });
  setTimeout(watch, REFRESH_MS);
}
