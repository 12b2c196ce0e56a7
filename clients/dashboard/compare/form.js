// What to compare and how: the two meshes, direction, reading of quads, tolerance, threshold.

import { choiceKey, meshChoice } from "../core/choice.js";
import { h, select } from "../core/dom.js";
import { state } from "../core/state.js";

/** @import { HausdorffRequest } from "../../js/types.js" */
/** @typedef {{ direction: string, quads: string, tolerance: string, threshold: string }} Settings */

/** @type {Settings} as they were left */
export const settings = { direction: "two_sided", quads: "triangles", tolerance: "1e-6", threshold: "" };

/** @param {{ onMeasure: () => void, onStop: () => void, onReading: () => void, onSwap: () => void }} options */
export function makeForm({ onMeasure, onStop, onReading, onSwap }) {
  const sides = h("div", { className: "form whole" });
  const direction = select("direction", [["two_sided", "both ways"], ["a_to_b", "from A to B"], ["b_to_a", "from B to A"]], settings.direction);
  const quads = select("quads", [["triangles", "two triangles"], ["bilinear", "a bilinear patch"]], settings.quads);
  const tolerance = h("input", { name: "tolerance", inputMode: "decimal", value: settings.tolerance, required: true, pattern: NUMBER, title: "a number above 0" });
  const threshold = h("input", { name: "threshold", inputMode: "decimal", value: settings.threshold, placeholder: "none", pattern: NUMBER, title: "a number" });
  const measure = h("button", { type: "submit", className: "primary" }, "Measure");
  const stop = h("button", { type: "button", disabled: true, onclick: onStop }, "Stop");
  const swap = h("button", { type: "button", onclick: onSwap }, "Swap A and B");
  const form = h("form", { className: "form", "aria-label": "Comparison" }, sides,
    h("label", {}, "Direction", direction), h("label", {}, "A quad is", quads),
    h("label", {}, "Tolerance, of A's diagonal", tolerance), h("label", {}, "Threshold, in the meshes' unit", threshold),
    h("div", { className: "row whole" }, measure, stop, swap));
  form.addEventListener("input", () => {
    const before = settings.quads;
    Object.assign(settings, { direction: direction.value, quads: quads.value, tolerance: tolerance.value, threshold: threshold.value });
    if (settings.quads !== before) onReading();
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    onMeasure();
  });

  let drawn = "";
  /** The meshes to choose from, and what may be done now. @param {boolean} isRunning */
  function draw(isRunning) {
    if (choiceKey() !== drawn) sides.replaceChildren(meshChoice("a"), meshChoice("b"));
    drawn = choiceKey();
    measure.disabled = state.a === null || state.b === null;
    stop.disabled = !isRunning;
    swap.disabled = state.a === null && state.b === null;
  }

  /** Shows the settings of a request. @param {Record<string, any>} request */
  function fill(request) {
    direction.value = request.direction;
    quads.value = request.quads;
    tolerance.value = String(request.tolerance_unit === "absolute" ? settings.tolerance : request.tolerance);
    threshold.value = request.threshold === null || request.threshold === undefined ? "" : String(request.threshold);
    form.dispatchEvent(new Event("input"));
  }
  return { form, draw, fill };
}

const NUMBER = "\\s*[0-9]*\\.?[0-9]+([eE][\\-+]?[0-9]+)?\\s*";

/** @returns {HausdorffRequest} of the form's settings */
export function readRequest() {
  return {
    type: "hausdorff", a: /** @type {string} */ (state.a), b: /** @type {string} */ (state.b),
    direction: /** @type {any} */ (settings.direction), quads: /** @type {any} */ (settings.quads),
    tolerance: Number(settings.tolerance), ...(settings.threshold.trim() === "" ? {} : { threshold: Number(settings.threshold) }),
  };
}
