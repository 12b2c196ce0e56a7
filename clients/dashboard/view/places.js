// A list of places: each of them flies to where it is seen.

import { h } from "../core/dom.js";
import { run } from "../core/messages.js";
import { lookAt } from "./view.js";

/** @typedef {{ words: string, points: number[][], what: string }} Place points: the first one has to be seen; what: in a sentence, such as "the contact" */

/**
 * @param {string} label
 * @param {Place[]} places
 * @param {(place: number) => void} onChosen before the flight
 * @param {number} [chosen] the one that is looked at already
 */
export function makePlaces(label, places, onChosen, chosen = -1) {
  const buttons = places.map(({ words, points, what }, at) => h("button", {
    type: "button", "aria-pressed": at === chosen, onclick: () => {
      buttons.forEach((button, other) => button.setAttribute("aria-pressed", String(other === at)));
      onChosen(at);
      run(() => lookAt(points, what));
    },
  }, words));
  return h("ol", { className: "places", "aria-label": label }, ...buttons.map((button) => h("li", {}, button)));
}
