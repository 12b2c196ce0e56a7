// Labels of meshes and jobs: words that their lists are narrowed to.

import { h } from "./dom.js";
import { run } from "./messages.js";

/**
 * A field with the labels of something, for changing them.
 * @param {string[]} labels
 * @param {(labels: string[]) => Promise<unknown>} save
 */
export function makeLabels(labels, save) {
  const input = h("input", { name: "labels", value: labels.join(", "), autocomplete: "off", spellcheck: false, placeholder: "none" });
  input.addEventListener("change", () => run(async () => {
    const wanted = input.value.split(/[\s,]+/).filter((label) => label !== "");
    try {
      await save([...new Set(wanted)]);
    } catch (error) {
      input.value = labels.join(", ");
      throw error;
    }
  }));
  return h("label", {}, "Labels, separated by commas", input);
}
