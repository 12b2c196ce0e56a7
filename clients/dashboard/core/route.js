// The page and its choices in the address: #compare?a=m_1&b=m_2.

import { changed, state } from "./state.js";

/** @type {URLSearchParams} of the address when the page was entered */
let parameters = new URLSearchParams();

/**
 * Reads an address.
 * @param {string[]} pages the known ones, the first one by default
 * @param {string} hash
 */
export function readAddress(pages, hash) {
  const [page, query = ""] = hash.slice(1).split("?");
  state.page = pages.includes(page) ? page : pages[0];
  parameters = new URLSearchParams(query);
  state.a = parameters.get("a") ?? state.a;
  state.b = parameters.get("b") ?? state.b;
  if (parameters.has("a") || parameters.has("pose")) state.pose = { mesh: state.a, text: parameters.get("pose") };
  state.shown = parameters.get("mesh") ?? state.shown;
  changed("page", "choice");
}

/** @param {string} name */
export const parameter = (name) => parameters.get(name);

/**
 * Puts choices into the address without a new entry in the history.
 * @param {Record<string, string | number | null | undefined>} choices null takes one out
 */
export function setParameters(choices) {
  for (const [name, value] of Object.entries(choices)) {
    if (value === null || value === undefined || value === "") parameters.delete(name);
    else parameters.set(name, String(value));
  }
  history.replaceState(null, "", address());
}

function address() {
  const query = parameters.toString().replaceAll("%2C", ",");
  return `${location.pathname}#${state.page}${query ? `?${query}` : ""}`;
}
