// The list of meshes: a picture, the name, and buttons that make a mesh A or B of a comparison. It can be narrowed to names and labels.

import { client } from "../core/connection.js";
import { h } from "../core/dom.js";
import { summary } from "../core/format.js";
import { run } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { changed, state } from "../core/state.js";
import { thumbnailOf } from "./thumbnails.js";

/** @import { Mesh } from "../../js/types.js" */

/** With fewer meshes there is nothing to search for. */
const FEW = 6;

export class MeshList {
  constructor() {
    this.element = h("ul", { className: "meshes", "aria-label": "Meshes" });
    this.name = h("input", { type: "search", name: "filter", placeholder: "Part of a name", "aria-label": "List meshes with this in their names", value: parameter("name") ?? "" });
    this.label = h("select", { name: "label", "aria-label": "List meshes with this label" });
    this.filter = h("span", { className: "row" }, this.name, this.label);
    this.wantedLabel = parameter("label") ?? "";
    /** What the daemon lists of the label; null while it was not asked. @type {Set<string> | null} */
    this.labelled = null;
    this.asked = 0;
    this.name.addEventListener("input", () => this.narrow());
    this.label.addEventListener("change", () => {
      this.wantedLabel = this.label.value;
      this.labelled = null;
      this.narrow();
      run(() => this.ask());
    });
  }

  narrow() {
    setParameters({ name: this.name.value.trim(), label: this.wantedLabel });
    this.draw();
  }

  /** Has the daemon list the meshes of the label. */
  async ask() {
    const mine = ++this.asked;
    if (this.wantedLabel === "") return;
    /** @type {Set<string>} */
    const found = new Set();
    for await (const { id } of client.meshes.list({ label: this.wantedLabel, pageSize: 1000 })) found.add(id);
    if (mine !== this.asked) return;
    this.labelled = found;
    this.draw();
  }

  /** The meshes are others, or have other labels. */
  refresh() {
    this.draw();
    run(() => this.ask());
  }

  drawLabels() {
    const labels = [...new Set([...state.meshes.flatMap((mesh) => mesh.labels ?? []), this.wantedLabel])].filter((label) => label !== "").sort();
    const options = ["", ...labels];
    if (options.join("\n") !== [...this.label.options].map(({ value }) => value).join("\n")) {
      this.label.replaceChildren(...options.map((label) => h("option", { value: label }, label === "" ? "all labels" : label)));
    }
    this.label.value = this.wantedLabel;
    this.label.hidden = labels.length === 0;
  }

  draw() {
    const { element } = this;
    this.drawLabels();
    const words = this.name.value.trim().toLowerCase();
    this.name.hidden = state.meshes.length < FEW && words === "";
    if (state.meshes.length === 0) {
      element.replaceChildren(h("li", { className: "empty" }, state.hasMeshes ? "There is no mesh yet." : "Asking the daemon."));
      return;
    }
    const focused = element.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
    const found = state.meshes.filter(({ name, id }) => (name || id).toLowerCase().includes(words) && (this.wantedLabel === "" || (this.labelled?.has(id) ?? false)));
    element.replaceChildren(...found.map(item).reverse());
    if (found.length === 0) element.replaceChildren(h("li", { className: "empty" }, this.emptyWords(words)));
    if (focused) /** @type {HTMLElement | null} */ (element.querySelector(`[data-key="${CSS.escape(focused)}"]`))?.focus();
  }

  /** @param {string} words of names */
  emptyWords(words) {
    if (this.wantedLabel !== "" && !this.labelled) return "Asking the daemon.";
    if (this.wantedLabel === "") return "No name has this in it.";
    return words === "" ? "No mesh has this label." : "No mesh with this label has this in its name.";
  }
}

/** @param {Mesh} mesh */
function item(mesh) {
  const name = mesh.name || mesh.id;
  const isShown = state.shown === mesh.id;
  const labels = mesh.labels ?? [];
  return h("li", { className: `mesh${isShown ? " is-shown" : ""}` },
    thumbnailOf(mesh),
    h("button", {
      type: "button", className: "name", "aria-pressed": isShown, "data-key": `show ${mesh.id}`, title: name,
      onclick: () => choose("shown", mesh.id),
    }, name),
    h("span", { className: "sides" }, side("a", mesh, name), side("b", mesh, name)),
    h("span", { className: "what" }, summary(mesh), mesh.warnings.length > 0 && " · see remarks", labels.length > 0 && ` · ${labels.join(", ")}`));
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
