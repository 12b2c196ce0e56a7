// The page of meshes: upload, list, and what is known of the one that is shown.

import { h } from "../core/dom.js";
import { setParameters } from "../core/route.js";
import { meshOf, on, state } from "../core/state.js";
import { makeUpload } from "../core/upload.js";
import { keepLook, placeEye } from "../view/link.js";
import { drawTools } from "../view/tools.js";
import { look, setLook, show } from "../view/view.js";
import { drawFacts } from "./facts.js";
import { MeshList } from "./list.js";
import { makeSamples } from "./samples.js";
import { letThumbnailsDraw } from "./thumbnails.js";

/** @param {HTMLElement} panel */
export function showMeshes(panel) {
  const list = new MeshList();
  const facts = h("section", { className: "section", "aria-labelledby": "facts-title" });
  const upload = makeUpload();
  upload.prepend(h("p", { className: "muted" }, "How far is a mesh from another one, or from a scan? Upload both and compare them: each distance comes with"
    + " bounds that are proven. Find where meshes meet, deform them, sketch quads over a surface. All of it can be done by programs, too: ",
    h("a", { href: "/docs" }, "the API"), "."));
  upload.append(makeSamples());
  panel.append(
    upload,
    h("section", { className: "section", "aria-labelledby": "list-title" },
      h("header", {}, h("h2", { id: "list-title" }, "Meshes"), list.filter), list.element),
    facts);
  /** @type {string | null} */
  let drawn = null;

  function drawView() {
    const mesh = meshOf(state.shown);
    const key = mesh ? `${mesh.id} ${mesh.revision} ${look.bilinear}` : "";
    if (key === drawn) return;
    drawn = key;
    setParameters({ mesh: mesh?.id });
    drawTools(mesh ? [mesh] : [], { onReading: drawView, hasStructure: true });
    const words = state.meshes.length > 0 ? "Choose a mesh to see it here." : "Drop a mesh file on the page to begin.";
    letThumbnailsDraw(false);
    show(mesh ? [{ mesh, role: "a", isBilinear: look.bilinear }] : [], words).then((isWhole) => {
      if (isWhole) placeEye();
      letThumbnailsDraw(isWhole);
    });
  }

  function draw() {
    if (state.shown === null && state.meshes.length > 0) state.shown = state.meshes[state.meshes.length - 1].id;
    list.draw();
    drawFacts(facts, meshOf(state.shown));
    drawView();
  }

  setLook({ heat: false, structure: true });
  const stopLook = keepLook();
  draw();
  list.refresh();
  const offs = [on(["meshes", "choice", "info"], draw), on("meshes", () => list.refresh())];
  return () => {
    for (const off of offs) off();
    stopLook();
    letThumbnailsDraw(false);
  };
}
