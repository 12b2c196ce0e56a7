// Uploads: by choice or by drop anywhere on the page, one after the other, each with its progress.

import { client, noteLoss } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { h } from "../core/dom.js";
import { bytes } from "../core/format.js";
import { sayFault } from "../core/messages.js";
import { changed, state } from "../core/state.js";

const uploads = h("div", { className: "uploads" });
/** @type {Promise<void>} the uploads before the next one */
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
  return h("section", { className: "section", "aria-label": "Upload" }, drop, uploads);
}

/** Files may be dropped on any part of the page. */
function listenToDrops() {
  const mark = (/** @type {boolean} */ isOver) => document.querySelector(".drop")?.classList.toggle("over", isOver);
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
listenToDrops();

/** @param {File[]} files */
function add(files) {
  for (const file of files) {
    const stop = new AbortController();
    const bar = h("progress", { max: 1, value: 0, "aria-label": `Upload of ${file.name}` });
    const words = h("span", { className: "muted small number" }, "waits");
    const cancel = h("button", { type: "button", className: "quiet", onclick: () => stop.abort() }, "Cancel");
    const row = h("div", { className: "upload" }, h("div", { className: "row" }, file.name, words, cancel), bar);
    uploads.append(row);
    before = before.then(() => send(file, stop.signal, (sent, total) => {
      bar.value = total > 0 ? sent / total : 1;
      words.textContent = sent < total ? `${bytes(sent)} of ${bytes(total)}` : "the daemon reads it";
    })).finally(() => row.remove());
  }
}

/**
 * @param {File} file
 * @param {AbortSignal} signal
 * @param {(sent: number, total: number) => void} onProgress
 */
async function send(file, signal, onProgress) {
  try {
    const { mesh } = await client.meshes.create(file, { name: file.name, onProgress, signal });
    state.shown = mesh.id;
    if (state.a === null) state.a = mesh.id;
    else if (state.b === null && state.a !== mesh.id) state.b = mesh.id;
    await refreshMeshes();
    changed("choice");
  } catch (error) {
    noteLoss(error);
    sayFault(error, file.name);
  }
}
