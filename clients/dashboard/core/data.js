// Reads the list of meshes, and keeps it fresh.

import { client, noteLoss } from "./connection.js";
import { isHeld } from "./deletion.js";
import { sayFault } from "./messages.js";
import { changed, on, state } from "./state.js";

/** @import { Mesh } from "../js/types.js" */

const LOOK_MS = 4000;

/** @param {unknown} error */
function note(error) {
  noteLoss(error);
  if (state.connection === "open") sayFault(error);
}

export async function refreshMeshes() {
  try {
    /** @type {Mesh[]} */
    const all = [];
    for await (const mesh of client.meshes.list({ pageSize: 1000 })) all.push(mesh);
    state.meshes = all.filter(({ id }) => !isHeld(id));
    state.hasMeshes = true;
    for (const side of /** @type {const} */ (["a", "b", "shown"])) {
      if (state[side] !== null && !state.meshes.some((mesh) => mesh.id === state[side])) state[side] = null;
    }
    changed("meshes", "choice");
  } catch (error) {
    note(error);
  }
}

/** Others upload, too: the newest mesh tells whether there is something new. */
async function look() {
  try {
    if (state.page !== "jobs" && state.connection === "open" && document.visibilityState === "visible" && state.hasMeshes) {
      const { value: newest } = await client.meshes.list({ order: "newest", pageSize: 1 }).next();
      if (newest && !isHeld(newest.id) && !state.meshes.some(({ id }) => id === newest.id)) await refreshMeshes();
    }
  } catch (error) {
    noteLoss(error);
  }
  setTimeout(look, LOOK_MS);
}

export function startData() {
  on("connection", () => { if (state.connection === "open") refreshMeshes(); });
  setTimeout(look, LOOK_MS);
}
