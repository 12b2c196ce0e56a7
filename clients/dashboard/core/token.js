// The dialog for a bearer token. The token lives in the client's memory alone and is gone with the page.

import { h } from "./dom.js";

/** @type {HTMLDialogElement | null} */
let open = null;

/**
 * @param {string} words why
 * @param {(token: string | null) => void} onToken null: without one; not called when the dialog is put away
 */
export function askForToken(words, onToken) {
  if (open) return;
  const input = h("input", { type: "password", id: "token-input", autocomplete: "off", spellcheck: false });
  const form = h("form", { method: "dialog" },
    h("h2", { id: "token-title" }, "Token"),
    h("p", { className: "muted" }, `${words}. It is kept in memory until this page is closed, and nowhere else.`),
    h("label", { for: "token-input" }, "Bearer token"), input,
    h("div", { className: "row" }, h("button", { type: "submit", value: "cancel" }, "Cancel"), h("button", { type: "submit", className: "primary", value: "use" }, "Use it")));
  // Enter uses it, though Cancel comes first.
  input.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    dialog.close("use");
  });
  const dialog = h("dialog", { "aria-labelledby": "token-title" }, form);
  open = dialog;
  dialog.addEventListener("close", () => {
    const token = input.value.trim();
    dialog.remove();
    open = null;
    if (dialog.returnValue === "use") onToken(token === "" ? null : token);
  });
  document.body.append(dialog);
  dialog.showModal();
}
