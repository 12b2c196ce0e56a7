// What the page has to say: notes go by themselves, faults stay until they are put away.

import { ConnectionError, ProblemError } from "../js/index.js";
import { byId, h } from "./dom.js";

const NOTE_MS = 5000;
const MOST_MESSAGES = 4;

/**
 * @param {string} words
 * @param {{ isFault?: boolean, details?: string[], action?: HTMLElement, ms?: number }} [options] action: a button; such a message
 *   stays when the view is left; ms: how long it stays
 * @returns {() => void} what puts it away
 */
export function say(words, { isFault = false, details = [], action, ms = NOTE_MS } = {}) {
  const close = h("button", { type: "button", className: "quiet", "aria-label": "Put this message away", onclick: () => box.remove() }, "✕");
  const box = h("div", { className: `message${isFault ? " is-fault" : ""}` }, h("p", {}, words), h("span", { className: "row" }, action, close),
    details.length > 0 && h("ul", {}, ...details.map((detail) => h("li", {}, detail))));
  if (action) box.dataset.kept = "yes";
  byId("messages").append(box);
  const others = byId("messages").querySelectorAll(".message:not([data-kept])");
  for (let place = 0; place < others.length - MOST_MESSAGES; place++) others[place].remove();
  if (!isFault) setTimeout(() => box.remove(), ms);
  return () => box.remove();
}

/** Puts away what was said of a view that is left. */
export const forgetMessages = () => byId("messages").querySelectorAll(".message:not([data-kept])").forEach((box) => box.remove());

/**
 * A fault in words, with its places.
 * @param {unknown} error
 * @returns {{ words: string, details: string[] }}
 */
export function explain(error) {
  if (error instanceof ProblemError) {
    const details = error.places.map(({ line, offset, pointer, detail }) => {
      const place = line !== undefined ? `line ${line}` : offset !== undefined ? `byte ${offset}` : pointer ?? "";
      return detail === error.detail ? place : `${place}: ${detail}`;
    });
    return { words: error.detail, details: details.filter((detail) => detail !== "") };
  }
  if (error instanceof ConnectionError) return { words: `${error.message}.`, details: [] };
  return { words: error instanceof Error ? error.message : String(error), details: [] };
}

/**
 * Says what went wrong; a request that was called off on purpose is nothing to speak of.
 * @param {unknown} error
 * @param {string} [prefix] such as the name of a file
 */
export function sayFault(error, prefix = "") {
  if (error instanceof DOMException && error.name === "AbortError") return;
  const { words, details } = explain(error);
  say(prefix ? `${prefix}: ${words}` : words, { isFault: true, details });
}

/** Runs something whose fault is to be told. @param {() => Promise<unknown>} action */
export function run(action) {
  return action().catch(sayFault);
}
