// The list of meshes: a picture, the name, and buttons that make a mesh A or B of a comparison.

import { h } from "../core/dom.js";
import { summary } from "../core/format.js";
import { changed, state } from "../core/state.js";
import { thumbnailOf } from "./thumbnails.js";

/** @import { Mesh } from "../../js/types.js" */

/** Names with other words than these are not listed. */
let wanted = "";
/** With fewer meshes there is nothing to search for. */
const FEW = 6;

/** A field that narrows the list. @param {() => void} onChange */
export function makeFilter(onChange) {
  const input = h("input", { type: "search", name: "filter", placeholder: "Part of a name", "aria-label": "List meshes with this in their names", value: wanted });
  input.addEventListener("input", () => {
    wanted = input.value.trim().toLowerCase();
    onChange();
  });
  return input;
}

/** @param {HTMLElement} list @param {HTMLElement} filter */
export function drawList(list, filter) {
  filter.hidden = state.meshes.length < FEW && wanted === "";
  if (state.meshes.length === 0) {
    const words = state.hasMeshes ? "There is no mesh yet." : "Asking the daemon.";
    list.replaceChildren(h("li", { className: "empty" }, words));
    return;
  }
  const focused = list.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
  const found = state.meshes.filter(({ name, id }) => (name || id).toLowerCase().includes(wanted));
  list.replaceChildren(...found.map(item).reverse());
  if (found.length === 0) list.replaceChildren(h("li", { className: "empty" }, "No name has this in it."));
  if (focused) /** @type {HTMLElement | null} */ (list.querySelector(`[data-key="${CSS.escape(focused)}"]`))?.focus();
}

/** @param {Mesh} mesh */
function item(mesh) {
  const name = mesh.name || mesh.id;
  const isShown = state.shown === mesh.id;
  return h("li", { className: `mesh${isShown ? " is-shown" : ""}` },
    thumbnailOf(mesh),
    h("button", {
      type: "button", className: "name", "aria-pressed": isShown, "data-key": `show ${mesh.id}`, title: name,
      onclick: () => choose("shown", mesh.id),
    }, name),
    h("span", { className: "sides" }, side("a", mesh, name), side("b", mesh, name)),
    h("span", { className: "what" }, summary(mesh), mesh.warnings.length > 0 && " · see remarks"));
}

/** @param {"a" | "b"} which @param {Mesh} mesh @param {string} name */
function side(which, mesh, name) {
  const isChosen = state[which] === mesh.id;
  return h("button", {
    type: "button", "aria-pressed": isChosen, "data-key": `${which} ${mesh.id}`,
    "aria-label": `${name} as ${which.toUpperCase()} of the comparison`, title: `${which.toUpperCase()} of the comparison`,
    onclick: () => choose(which, isChosen ? null : mesh.id),
  }, `as ${which.toUpperCase()}`);
}

/** @param {"a" | "b" | "shown"} which @param {string | null} id */
function choose(which, id) {
  state[which] = id;
  changed("choice");
}
