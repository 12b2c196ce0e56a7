// Uploads: by choice, or by drop anywhere on the page and in every view, one after the other, each with its progress.

import { client, noteLoss } from "./connection.js";
import { refreshMeshes } from "./data.js";
import { byId, h } from "./dom.js";
import { bytes } from "./format.js";
import { say, sayFault } from "./messages.js";
import { changed, state } from "./state.js";

/** @import { Mesh } from "../js/types.js" */

/** @type {Promise<unknown>} the uploads before the next one */
let before = Promise.resolve();

export function makeUpload() {
  const input = h("input", { type: "file", id: "files", multiple: true, accept: ".obj,.ply,.stl,.off,.glb,.gltf,.drc,.3mf,.xyz,.pcd,.gz,.txt" });
  input.addEventListener("change", () => {
    add([...(input.files ?? [])]);
    input.value = "";
  });
  input.className = "unseen";
  const drop = h("label", { className: "drop" }, h("strong", {}, "Drop meshes or scans here, or choose files"),
    h("span", { className: "muted small" }, "OBJ, PLY, STL, OFF, GLB, DRC, 3MF, XYZ, PCD"), input);
  return h("section", { className: "section", "aria-label": "Upload" }, drop);
}

/** Files may be dropped on any part of the page: nowhere does the browser leave the page for them. */
export function listenToDrops() {
  const mark = (/** @type {boolean} */ isOver) => {
    document.body.classList.toggle("is-over", isOver);
    document.querySelector(".drop")?.classList.toggle("over", isOver);
  };
  addEventListener("dragover", (event) => {
    event.preventDefault();
    mark(true);
  });
  addEventListener("dragleave", (event) => { if (event.relatedTarget === null) mark(false); });
  addEventListener("drop", (event) => {
    event.preventDefault();
    mark(false);
    add([...(event.dataTransfer?.files ?? [])]);
  });
}
/**
 * Uploads files, one after the other.
 * @param {File[]} files
 * @returns {Promise<Mesh | null>[]} null: it was refused, or called off; the page has said why
 */
export function add(files) {
  return files.map((file) => {
    const stop = new AbortController();
    const bar = h("progress", { max: 1, value: 0, "aria-label": `Upload of ${file.name}` });
    const words = h("span", { className: "muted small number" }, "waits");
    const cancel = h("button", { type: "button", className: "quiet", onclick: () => stop.abort() }, "Cancel");
    const row = h("div", { className: "upload" }, h("div", { className: "row" }, file.name, words, cancel), bar);
    byId("uploads").append(row);
    const sent = before.then(() => send(file, stop.signal, (done, total) => {
      bar.value = total > 0 ? done / total : 1;
      words.textContent = done < total ? `${bytes(done)} of ${bytes(total)}` : "the daemon reads it";
    })).finally(() => row.remove());
    before = sent;
    return sent;
  });
}

/**
 * @param {File} file
 * @param {AbortSignal} signal
 * @param {(sent: number, total: number) => void} onProgress
 * @returns {Promise<Mesh | null>}
 */
async function send(file, signal, onProgress) {
  try {
    const { mesh } = await client.meshes.create(file, { name: file.name, onProgress, signal });
    state.shown = mesh.id;
    if (state.a === null) state.a = mesh.id;
    else if (state.b === null && state.a !== mesh.id) state.b = mesh.id;
    await refreshMeshes();
    changed("choice");
    if (state.page !== "meshes") say(`${mesh.name || mesh.id} is here.`);
    return mesh;
  } catch (error) {
    noteLoss(error);
    sayFault(error, file.name);
    return null;
  }
}
