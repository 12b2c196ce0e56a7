// The tools over the 3D view. Each page says which of them it wants.

import { byId, h } from "../core/dom.js";
import { on } from "../core/state.js";
import { currentStage, look, setLook } from "./view.js";

/** @import { Mesh } from "../../js/types.js" */

/**
 * A button that is on or off.
 * @param {string} words
 * @param {string} title
 * @param {boolean} isOn
 * @param {(isOn: boolean) => void} onChange
 */
export function toggle(words, title, isOn, onChange) {
  const button = h("button", { type: "button", title, "aria-pressed": isOn }, words);
  button.addEventListener("click", () => {
    const now = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(now));
    onChange(now);
  });
  return button;
}

/**
 * @param {Mesh[]} meshes what is shown
 * @param {{ onReading?: () => void, hasStructure?: boolean, more?: HTMLElement[] }} [options]
 *   onReading: the reading of quads was changed; hasStructure: patches and irregular vertices may be shown
 */
export function drawTools(meshes, { onReading, hasStructure = false, more = [] } = {}) {
  const place = byId("stage-tools");
  if (meshes.length === 0) return place.replaceChildren();
  const hasFaces = meshes.some((mesh) => mesh.kind !== "points");
  const hasQuads = meshes.some((mesh) => mesh.faces.quads > 0);
  const hasPoints = meshes.some((mesh) => mesh.kind === "points");
  /** @type {(HTMLElement | false)[]} */
  const tools = [
    h("button", { type: "button", title: "Show all (F)", onclick: () => { currentStage()?.fit(); } }, "Fit"),
    hasFaces && toggle("Edges", "Draw the edges of the faces", look.wire, (wire) => setLook({ wire })),
    hasQuads && hasStructure && toggle("Patches", "Colour the regular patches", look.patches, (patches) => setLook({ patches })),
    hasQuads && hasStructure && toggle("Irregular", "Mark inner vertices without four quads: blue below four, red above", look.irregular,
      (irregular) => setLook({ irregular })),
    hasQuads && onReading !== undefined && toggle("Bilinear", "Draw quads as the bilinear patches of their corners", look.bilinear, (bilinear) => {
      setLook({ bilinear });
      onReading?.();
    }),
    hasPoints && discSlider(),
    hasFaces && through(),
    ...more,
  ];
  return place.replaceChildren(...tools.filter((tool) => tool !== false));
}

/** The button that makes surfaces see-through; a flight to a place that no side shows presses it, too. */
function through() {
  const button = toggle("See through", "Draw the surfaces see-through", look.through, (isOn) => setLook({ through: isOn }));
  button.dataset.tool = "through";
  return button;
}
on("through", () => document.querySelector("[data-tool=through]")?.setAttribute("aria-pressed", String(look.through)));

function discSlider() {
  const input = h("input", { type: "range", min: "0.2", max: "4", step: "0.1", value: String(look.disc), "aria-label": "Size of the points" });
  input.addEventListener("input", () => setLook({ disc: Number(input.value) }));
  return h("label", {}, "Size", input);
}
