// Small pictures of the meshes in the list, drawn one after the other once they are looked at and the view has what it shows.

import { h } from "../core/dom.js";
import { changed, state } from "../core/state.js";
import { currentStage } from "../view/view.js";

/** @import { Mesh } from "../../js/types.js" */

const WIDTH = 128;
const HEIGHT = 96;
/** Larger meshes are not fetched for a picture alone: theirs is taken when they are shown. */
const MOST_VERTICES = 100000;

/** @type {Map<string, string>} addresses of pictures by mesh and revision; "" where there is none to be had */
const pictures = new Map();
/** What is looked at and has no picture yet: ids. @type {Set<string>} */
const wanted = new Set();
let isDrawing = false;
let isFree = false;

/** @param {Mesh} mesh */
const keyOf = (mesh) => `${mesh.id} ${mesh.revision}`;

const watcher = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    const id = /** @type {HTMLElement} */ (target).dataset.mesh ?? "";
    if (isIntersecting) wanted.add(id);
    else wanted.delete(id);
  }
  drawNext();
});

/** @param {Mesh} mesh */
export function thumbnailOf(mesh) {
  const picture = pictures.get(keyOf(mesh));
  if (picture) return h("img", { className: "thumbnail", src: picture, alt: "", width: WIDTH / 2, height: HEIGHT / 2 });
  const place = h("span", { className: "thumbnail", "data-mesh": mesh.id });
  if (picture === undefined) watcher.observe(place);
  return place;
}

/** The view has what it shows; or it has not, and comes first. @param {boolean} isWhole */
export function letThumbnailsDraw(isWhole) {
  isFree = isWhole;
  drawNext();
}

async function drawNext() {
  const stage = currentStage();
  const mesh = state.meshes.filter((found) => wanted.has(found.id) && !pictures.has(keyOf(found))
    && (found.vertices <= MOST_VERTICES || found.id === state.shown)).at(-1); // the list's first
  if (isDrawing || !isFree || !stage || !mesh) return;
  isDrawing = true;
  pictures.set(keyOf(mesh), "");
  try {
    const { drawThumbnail } = await import("../view/thumbnail.js");
    const picture = await drawThumbnail(stage, mesh, WIDTH, HEIGHT);
    const canvas = h("canvas", { width: WIDTH, height: HEIGHT });
    canvas.getContext("2d", { willReadFrequently: true })?.putImageData(picture, 0, 0); // not by the graphics card, which is busy
    const blob = await new Promise((/** @type {BlobCallback} */ resolve) => { canvas.toBlob(resolve); });
    if (blob) pictures.set(keyOf(mesh), URL.createObjectURL(blob));
    changed("meshes");
  } catch {
    // A mesh that cannot be read stays without a picture; who chooses it is told why.
  } finally {
    isDrawing = false;
    drawNext();
  }
}
