// What only the owner of a mesh knows: the unit of its numbers, and how far the true surface may be.

import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { h, select } from "../core/dom.js";
import { run, say } from "../core/messages.js";

/** @import { Mesh, Unit } from "../../js/types.js" */

const UNITS = /** @type {[string, string][]} */ ([["", "not known"], ["um", "µm"], ["mm", "mm"], ["cm", "cm"], ["m", "m"], ["in", "inch"], ["ft", "foot"]]);

/** @param {Mesh} mesh */
export function makeNotes(mesh) {
  const unit = select("unit", UNITS, mesh.unit ?? "");
  const uncertainty = h("input", { name: "uncertainty", inputMode: "decimal", value: String(mesh.uncertainty), autocomplete: "off" });
  const change = (/** @type {{ unit?: Unit | null, uncertainty?: number }} */ notes) => run(async () => {
    await client.meshes.change(mesh.id, notes);
    await refreshMeshes();
  });
  unit.addEventListener("change", () => change({ unit: /** @type {Unit} */ (unit.value) || null }));
  uncertainty.addEventListener("change", () => {
    const value = Number(uncertainty.value.trim() || 0);
    if (value >= 0 && Number.isFinite(value)) change({ uncertainty: value });
    else say("The uncertainty is a number that is 0 or more.", { isFault: true });
  });
  return h("div", { className: "form" }, h("label", {}, "Unit", unit), h("label", {}, "Uncertainty, in that unit", uncertainty));
}
