// A quad mesh as a file with texture coordinates of its patches.

import { client } from "../core/connection.js";
import { download, h, select } from "../core/dom.js";
import { run, say } from "../core/messages.js";

/** @import { Format, Mesh } from "../../js/types.js" */

const FORMATS = /** @type {[string, string][]} */ ([["glb", "GLB"], ["obj", "OBJ"], ["ply", "PLY"]]);

/** @param {Mesh} mesh */
export function textured(mesh) {
  const format = select("textured-format", FORMATS, "glb");
  format.setAttribute("aria-label", "Format with texture coordinates");
  const fetchFile = async () => {
    const { bytes } = await client.meshes.content(mesh.id, { format: /** @type {Format} */ (format.value), uv: "patches" });
    download(new Blob([bytes]), `${mesh.name || mesh.id}.${format.value}`);
    say("Each patch is a rectangle of the picture, as many cells wide and high as it has columns and rows.");
  };
  return h("div", { className: "row" }, format, h("button", { type: "button", onclick: () => run(fetchFile) }, "Save with texture coordinates"));
}
