// Deletions that can be undone: what is deleted is put out of sight at once, and from the daemon when the time to undo is over. A page
// that is closed before keeps it.

import { ProblemError } from "../js/index.js";
import { h } from "./dom.js";
import { run, say } from "./messages.js";

const UNDO_MS = 8000;

/** What is out of sight and not deleted yet: ids. @type {Set<string>} */
const held = new Set();

/** Is something about to be deleted? @param {string} id */
export const isHeld = (id) => held.has(id);

/**
 * @param {object} options
 * @param {string} options.id
 * @param {string} options.words such as "box.off is deleted."
 * @param {() => Promise<void>} options.commit deletes it
 * @param {() => unknown} options.onChange called when it goes out of sight, and when it is back
 */
export function deleteLater({ id, words, commit, onChange }) {
  held.add(id);
  const putAway = say(words, { ms: UNDO_MS, action: h("button", { type: "button", onclick: undo }, "Undo") });
  const timer = setTimeout(() => run(end), UNDO_MS);
  onChange();

  function undo() {
    clearTimeout(timer);
    held.delete(id);
    putAway();
    onChange();
  }

  async function end() {
    try {
      await commit();
    } catch (error) {
      if (error instanceof ProblemError && error.status === 404) return; // somebody else has deleted it
      held.delete(id);
      onChange();
      throw error;
    }
  }
}
