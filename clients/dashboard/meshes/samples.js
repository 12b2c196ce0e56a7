// Pairs of meshes by formulas, for who has no files at hand: made here, uploaded like any other, and compared.

import { h } from "../core/dom.js";
import { run } from "../core/messages.js";
import { add } from "../core/upload.js";

/** @typedef {{ words: string, title: string, a: [string, number, string], b: [string, number, string] }} Sample name, steps a side, shape */

/** @type {Sample[]} */
const SAMPLES = [
  { words: "A part and what it should be", title: "A block with a dent and an end that is too thick, and the block as designed", a: ["part.obj", 40, "dented"], b: ["design.obj", 24, "block"] },
  { words: "Coarse quads and a fine surface", title: "Quads whose vertices lie on a finer surface: how far is it between them?", a: ["coarse quads.obj", 6, "hills"], b: ["fine surface.obj", 48, "hills"] },
];

/** Uploads a pair, and shows how far apart it is. @param {Sample} sample */
async function open({ a, b }) {
  const { objOf } = await import("./formulas.js");
  const files = [a, b].map(([name, steps, shape]) => new File([objOf(steps, shape)], name));
  const [first, second] = await Promise.all(add(files));
  if (first && second) location.hash = `#compare?a=${first.id}&b=${second.id}&heat=1`;
}

export function makeSamples() {
  return h("p", { className: "row samples" }, h("span", { className: "muted small" }, "No files at hand?"), ...SAMPLES.map((sample) =>
    h("button", { type: "button", title: sample.title, onclick: () => run(() => open(sample)) }, sample.words)));
}
