// Choices of meshes, for the forms.

import { h, select } from "./dom.js";
import { setParameters } from "./route.js";
import { changed, state } from "./state.js";

/** @import { Mesh } from "../js/types.js" */

/**
 * A labelled choice of A or B.
 * @param {"a" | "b"} which
 * @param {{ words?: string, none?: string, fits?: (mesh: Mesh) => boolean }} [options] none: what no mesh means
 */
export function meshChoice(which, { words = which.toUpperCase(), none = "choose a mesh", fits = () => true } = {}) {
  const meshes = state.meshes.filter(fits);
  const options = /** @type {[string, string][]} */ ([["", meshes.length > 0 ? none : "none yet"],
    ...meshes.map((mesh) => [mesh.id, mesh.name || mesh.id])]);
  const choice = select(which, options, state[which] ?? "");
  choice.addEventListener("change", () => {
    state[which] = choice.value || null;
    setParameters({ [which]: state[which] });
    changed("choice");
  });
  return h("label", {}, h("span", {}, h("span", { className: `swatch ${which}` }), words), choice);
}

/** What a list of choices depends on, to draw it only when it differs. */
export const choiceKey = () => `${state.a} ${state.b} ${state.meshes.map(({ id, name }) => id + name)}`;
