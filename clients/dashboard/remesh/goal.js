// How far to refine: a number of quads, a distance, or a single step.

import { h } from "../core/dom.js";

/** @import { Goal } from "./runner.js" */

/** As it was left. */
const left = { quads: "1000", distance: "" };

/** @param {{ onStep: () => void, onRun: (goal: Goal) => void, onStop: () => void }} options */
export function makeGoal({ onStep, onRun, onStop }) {
  const quads = h("input", { name: "quads", inputMode: "numeric", value: left.quads, placeholder: "any number", pattern: "\\s*[0-9]*\\s*", title: "a whole number" });
  const distance = h("input", { name: "distance", inputMode: "decimal", value: left.distance, placeholder: "any", pattern: "\\s*[0-9]*\\.?[0-9]*\\s*", title: "a number" });
  const once = h("button", { type: "button", disabled: true, onclick: onStep }, "One step");
  const all = h("button", { type: "submit", className: "primary", disabled: true }, "Run to the goal");
  const stop = h("button", { type: "button", disabled: true, onclick: onStop }, "Stop");
  const form = h("form", { className: "form", "aria-label": "Goal" },
    h("label", {}, "Quads, at most", quads), h("label", {}, "Distance, % of diagonal", distance),
    h("div", { className: "row whole" }, once, all, stop));
  form.addEventListener("input", () => Object.assign(left, { quads: quads.value, distance: distance.value }));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    onRun({
      ...(Number(quads.value) > 0 ? { max_quads: Number(quads.value) } : {}),
      ...(Number(distance.value) > 0 ? { hausdorff_relative: Number(distance.value) / 100 } : {}),
    });
  });
  /** @param {boolean} isRunning @param {boolean} hasMesh */
  function draw(isRunning, hasMesh) {
    once.disabled = all.disabled = isRunning || !hasMesh;
    stop.disabled = !isRunning;
  }
  return { form, draw };
}
