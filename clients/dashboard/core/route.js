// The page and its choices in the address: #compare?a=m_1&b=m_2. A link brings somebody else to the same view.

import { poseOfA, readPose, textOfPose } from "./pose.js";
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
  if (parameters.has("a") || parameters.has("pose")) readPose(parameters.get("pose")); // else A is as it was left
  state.shown = parameters.get("mesh") ?? state.shown;
  changed("page", "choice");
}

/** A choice that came with the address. @param {string} name */
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

/** Says in the address how A is moved. */
export function setPoseParameter() {
  const transform = poseOfA();
  setParameters({ pose: transform && textOfPose(transform) });
}

/** The address of what is on the page now. */
function address() {
  const query = parameters.toString().replaceAll("%2C", ",");
  return `${location.pathname}#${state.page}${query ? `?${query}` : ""}`;
}
