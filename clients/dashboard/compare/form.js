// What to compare and how: the two meshes, direction, reading of quads, gap, limit.

import { choiceKey, meshChoice } from "../core/choice.js";
import { NUMBER, h, numberOf, select } from "../core/dom.js";
import { parameter, setParameters } from "../core/route.js";
import { state } from "../core/state.js";
import { moved } from "../core/pose.js";

/** @import { HausdorffRequest } from "../../js/types.js" */
/** @typedef {{ direction: string, quads: string, gap: string, limit: string }} Settings */

/** @type {Settings} */
const FIRST = { direction: "two_sided", quads: "triangles", gap: "1e-6", limit: "" };
/** As they were left. */
export const settings = { ...FIRST };
const NAMES = /** @type {(keyof Settings)[]} */ (Object.keys(FIRST));

/** Takes up what the address says. */
export function readSettings() {
  for (const name of NAMES) settings[name] = parameter(name) ?? settings[name];
  writeSettings();
}

/** A link has what is not as at first. */
const writeSettings = () => setParameters(Object.fromEntries(NAMES.map((name) => [name, settings[name] === FIRST[name] ? null : settings[name]])));

/** @param {{ onMeasure: () => void, onStop: () => void, onInput: () => void, onReading: () => void, onSwap: () => void }} options */
export function makeForm({ onMeasure, onStop, onInput, onReading, onSwap }) {
  const sides = h("div", { className: "form whole" });
  const direction = select("direction", [["two_sided", "both ways"], ["a_to_b", "from A to B"], ["b_to_a", "from B to A"]], settings.direction);
  const quads = select("quads", [["triangles", "two triangles"], ["bilinear", "a bilinear patch"]], settings.quads);
  const gap = h("input", { name: "gap", inputMode: "decimal", value: settings.gap, required: true, pattern: NUMBER, title: "a number above 0" });
  const limit = h("input", { name: "limit", inputMode: "decimal", value: settings.limit, placeholder: "none", pattern: NUMBER, title: "a number" });
  const measure = h("button", { type: "submit", className: "primary" }, "Measure");
  const stop = h("button", { type: "button", disabled: true, onclick: onStop }, "Stop");
  const swap = h("button", { type: "button", onclick: onSwap }, "Swap A and B");
  const form = h("form", { className: "form", "aria-label": "Comparison" }, sides,
    h("label", {}, "Direction", direction), h("label", {}, "A quad is", quads),
    h("label", {}, "Gap, of A's diagonal", gap), h("label", {}, "Limit, in the meshes' unit", limit),
    h("div", { className: "row whole" }, measure, stop, swap));
  form.addEventListener("input", () => {
    const before = settings.quads;
    Object.assign(settings, { direction: direction.value, quads: quads.value, gap: gap.value, limit: limit.value });
    writeSettings();
    onInput();
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
    gap.value = String(request.gap_unit === "absolute" ? settings.gap : request.gap);
    limit.value = String(request.limit ?? "");
    form.dispatchEvent(new Event("input"));
  }
  return { form, draw, fill };
}

/** The permitted distance; null for none. @param {Settings} settings */
export const limitOf = ({ limit }) => numberOf(limit);

/** @returns {HausdorffRequest} of the form's settings */
export function readRequest() {
  return {
    type: "hausdorff", a: moved(), b: /** @type {string} */ (state.b),
    direction: /** @type {any} */ (settings.direction), quads: /** @type {any} */ (settings.quads),
    gap: Number(settings.gap), limit: limitOf(settings),
  };
}
