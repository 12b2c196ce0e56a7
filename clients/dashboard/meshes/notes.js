// What only the owner of a mesh knows: the unit of its numbers, how far the true surface may be, and the labels to find it by.

import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { h, select } from "../core/dom.js";
import { makeLabels } from "../core/labels.js";
import { run, say } from "../core/messages.js";

/** @import { Mesh, Unit } from "../../js/types.js" */

const UNITS = /** @type {[string, string][]} */ ([["", "not known"], ["um", "µm"], ["mm", "mm"], ["cm", "cm"], ["m", "m"], ["in", "inch"], ["ft", "foot"]]);

/** @param {Mesh} mesh */
export function makeNotes(mesh) {
  const unit = select("unit", UNITS, mesh.unit ?? "");
  const uncertainty = h("input", { name: "uncertainty", inputMode: "decimal", value: String(mesh.uncertainty), autocomplete: "off" });
  const save = async (/** @type {{ unit?: Unit | null, uncertainty?: number, labels?: string[] }} */ notes) => {
    await client.meshes.change(mesh.id, notes);
    await refreshMeshes();
  };
  const change = (/** @type {Parameters<typeof save>[0]} */ notes) => run(() => save(notes));
  unit.addEventListener("change", () => change({ unit: /** @type {Unit} */ (unit.value) || null }));
  uncertainty.addEventListener("change", () => {
    const value = Number(uncertainty.value.trim() || 0);
    if (value >= 0 && Number.isFinite(value)) change({ uncertainty: value });
    else say("The uncertainty is a number that is 0 or more.", { isFault: true });
  });
  return h("div", { className: "form" }, h("label", {}, "Unit", unit), h("label", {}, "Uncertainty, in that unit", uncertainty),
    h("div", { className: "whole" }, makeLabels(mesh.labels ?? [], (labels) => save({ labels }))));
}
