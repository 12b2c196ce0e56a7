// Small pictures of the meshes that were shown, taken from the 3D view.

import { h } from "../core/dom.js";
import { changed } from "../core/state.js";
import { currentStage } from "../view/view.js";

/** @import { Mesh } from "../../js/types.js" */

const WIDTH = 128;
const HEIGHT = 96;

/** @type {Map<string, string>} addresses of pictures by mesh and revision */
const pictures = new Map();
/** @param {Mesh} mesh */
const keyOf = (mesh) => `${mesh.id} ${mesh.revision}`;

/** @param {Mesh} mesh */
export function thumbnailOf(mesh) {
  const picture = pictures.get(keyOf(mesh));
  return picture ? h("img", { className: "thumbnail", src: picture, alt: "", width: WIDTH / 2, height: HEIGHT / 2 })
    : h("span", { className: "thumbnail" });
}

/** Takes the picture of a mesh that fills the view by now. @param {Mesh} mesh */
export async function noteShown(mesh) {
  const stage = currentStage();
  if (!stage || pictures.has(keyOf(mesh))) return;
  const picture = await stage.toThumbnail(WIDTH, HEIGHT, mesh);
  if (!picture) return;
  const canvas = h("canvas", { width: WIDTH, height: HEIGHT });
  canvas.getContext("2d")?.putImageData(picture, 0, 0);
  canvas.toBlob((blob) => {
    if (!blob) return;
    pictures.set(keyOf(mesh), URL.createObjectURL(blob));
    changed("meshes");
  });
}
