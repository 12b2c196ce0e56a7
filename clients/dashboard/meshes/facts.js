// What is known of a mesh; download in each format, and deletion.

import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { deleteLater } from "../core/deletion.js";
import { download, figures, h, select } from "../core/dom.js";
import { ENOUGH, bytes, count, duration, faceCount, intervals, length, time } from "../core/format.js";
import { run, say } from "../core/messages.js";
import { state } from "../core/state.js";
import { makeNotes } from "./notes.js";

/** @import { Extent, Format, Mesh } from "../../js/types.js" */

/** @type {string} what is drawn, so that an open choice is not shut by a redraw */
let drawn = "";

/** @param {HTMLElement} place @param {Mesh | undefined} mesh */
export function drawFacts(place, mesh) {
  const key = mesh ? `${mesh.id} ${mesh.revision} ${mesh.unit} ${mesh.uncertainty} ${mesh.labels} ${state.info !== null}` : "";
  if (key === drawn && place.childElementCount > 0) return;
  drawn = key;
  if (!mesh) {
    place.replaceChildren();
    return;
  }
  place.replaceChildren(
    h("header", {}, h("h2", { id: "facts-title" }, mesh.name || mesh.id), deletion(mesh)),
    mesh.warnings.length > 0 ? h("ul", { className: "warnings", "aria-label": "Remarks" }, ...mesh.warnings.map((words) => h("li", {}, words))) : "",
    figures(rows(mesh)), figures([["Box", sizeOf(mesh)], ...extents(mesh)], "figures single"), makeNotes(mesh),
    mesh.kind === "points" ? "" : quality(mesh), downloads(mesh));
}

/** @param {Mesh} mesh @returns {[string, string][]} */
function rows(mesh) {
  const { diagonal } = mesh.bounding_box;
  /** @type {[string, string][]} */
  const surface = mesh.kind === "points" ? [] : [
    ["Faces", count(faceCount(mesh.faces))],
    ["Triangles", count(mesh.faces.triangles)], ["Quads", count(mesh.faces.quads)],
    ["Polygons", count(mesh.faces.polygons)], ["Components", count(mesh.components)],
    ["Boundary edges", count(mesh.boundary_edges)], ["Manifold", mesh.manifold ? "yes" : "no"], ...topology(mesh),
  ];
  /** @type {[string, string][]} */
  const quads = mesh.patches === 0 ? [] : [
    ["Irregular vertices", count(mesh.irregular_vertices)], ["Regular patches", count(mesh.patches)],
    ["Largest patch", mesh.largest_patch ? `${count(mesh.largest_patch.rows)} × ${count(mesh.largest_patch.columns)}` : "–"],
  ];
  const prepared = Object.values(mesh.prepare_ms).reduce((sum, ms) => sum + ms, 0);
  return [
    [mesh.kind === "points" ? "Points" : "Vertices", count(mesh.vertices)], ...surface, ...quads,
    ["Diagonal", length(diagonal, 6)], ["File", `${mesh.format.toUpperCase()}, ${bytes(mesh.size_bytes)}`],
    ["In memory", bytes(mesh.memory_bytes)], ["Prepared in", duration(prepared)], ["Revision", count(mesh.revision)],
    ["Here since", time(mesh.created)],
  ];
}

/** What a mesh that an earlier version stored has not. @param {Mesh} mesh @returns {[string, string][]} */
function topology({ watertight, winding_consistent, genus, euler_number, degenerate_faces, duplicate_faces }) {
  if (watertight === undefined) return [];
  return [
    ["Watertight", watertight ? "yes" : "no"], ["Winding agrees", winding_consistent ? "yes" : "no"], ["Genus", count(genus)],
    ["Euler number", count(euler_number)], ["Degenerate faces", count(degenerate_faces)], ["Duplicate faces", count(duplicate_faces)],
  ];
}

/** Area and volume, as intervals that hold the exact ones. @param {Mesh} mesh @returns {[string, string][]} */
function extents({ area, volume, unit }) {
  /** @type {[string, Extent | null | undefined, string][]} */
  const all = [["Area", area, "²"], ["Volume", volume, "³"]];
  return all.flatMap(([name, extent, power]) => {
    if (!extent) return [];
    const { lower, upper } = extent;
    const words = lower === null || upper === null ? "too large for a number" : intervals([{ lower, upper }], ENOUGH)[0];
    return [/** @type {[string, string]} */ ([name, `${words}${unit ? ` ${unit}${power}` : ""}`])];
  });
}

/** @param {Mesh} mesh */
function sizeOf({ bounding_box: { min, max } }) {
  return min.map((low, k) => Number((max[k] - low).toPrecision(5))).join(" × ");
}

/** @param {Mesh} mesh */
export function downloads(mesh) {
  const unfit = mesh.kind === "points" ? ["stl", "3mf"] : ["xyz", "pcd"];
  const formats = (state.info?.formats ?? []).filter((format) => !unfit.includes(format));
  const format = select("format", formats.map((name) => [name, name.toUpperCase()]), mesh.format);
  format.setAttribute("aria-label", "Format of the download");
  const button = h("button", { type: "button", onclick: () => run(() => fetchFile(mesh, /** @type {Format} */ (format.value))) }, "Download");
  return h("div", { className: "row" }, format, button);
}

/** The shape of the faces, once it is asked for. @param {Mesh} mesh */
function quality(mesh) {
  const found = h("div", { className: "section", id: "quality" });
  const show = async () => (await import("./quality.js")).showQuality(found, mesh);
  return h("div", { className: "section" }, h("div", { className: "row" }, h("button", { type: "button", onclick: () => run(show) }, "Shape of the faces")), found);
}

/** @param {Mesh} mesh @param {Format} format */
async function fetchFile(mesh, format) {
  const file = await client.meshes.content(mesh.id, { format });
  const stem = (mesh.name || mesh.id).replace(/\.[a-z]{3}(?=$|, \d+ quads$)/i, "");
  download(new Blob([file.bytes]), `${stem}.${format}`);
  const losses = [
    file.cutFaces > 0 && `${count(file.cutFaces)} faces became triangles`,
    file.displacement > 0 && `no vertex lies farther from its place than ${length(file.displacement, 3)}`,
    file.leftOutVertices > 0 && `${count(file.leftOutVertices)} vertices that no face uses are left out`,
  ].filter((words) => words !== false);
  say(losses.length > 0 ? `${stem}.${format}: ${losses.join("; ")}.` : `${stem}.${format} has every coordinate as it was.`);
}

/** @param {Mesh} mesh */
function deletion(mesh) {
  return h("button", { type: "button", className: "danger", onclick: () => deleteLater({
    id: mesh.id, words: `${mesh.name || mesh.id} is deleted.`, commit: () => client.meshes.delete(mesh.id), onChange: refreshMeshes,
  }) }, "Delete");
}
