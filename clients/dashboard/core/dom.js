// Making elements, and finding those of the page.

/** @typedef {string | number | Node | null | undefined | false} Child */

/**
 * An element with properties, attributes and children: h("button", { type: "button", onclick: f, "aria-label": "x" }).
 * A name with a dash, and `role` and `for`, is an attribute; everything else a property. undefined is left out.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, any>} [properties]
 * @param {...Child} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined) continue;
    if (name.includes("-") || name === "role" || name === "for") element.setAttribute(name, String(value));
    else /** @type {any} */ (element)[name] = value;
  }
  element.append(...children.filter(isThere));
  return element;
}

/** @param {Child} child @returns {child is string | Node} */
const isThere = (child) => child !== null && child !== undefined && child !== false;

/**
 * @param {string} id
 * @returns {HTMLElement}
 */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return element;
}

/**
 * A list of figures: names and values.
 * @param {[string, Child][]} rows
 * @param {string} [className]
 */
export function figures(rows, className = "figures") {
  return h("dl", { className }, ...rows.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
}

/**
 * A choice of named values.
 * @param {string} name
 * @param {[string, string][]} options value and words
 * @param {string} chosen
 */
export function select(name, options, chosen) {
  return h("select", { name }, ...options.map(([value, words]) => h("option", { value, selected: value === chosen }, words)));
}

/** What a field for a number that is 0 or more takes. */
export const NUMBER = "\\s*[0-9]*\\.?[0-9]+([eE][\\-+]?[0-9]+)?\\s*";

/** What such a field says; null when it is empty, or has something else. @param {string} text */
export function numberOf(text) {
  const value = Number(text);
  return text.trim() === "" || !(value >= 0 && Number.isFinite(value)) ? null : value;
}

/**
 * Hands bytes to the browser as a download.
 * @param {Blob} blob
 * @param {string} name
 */
export function download(blob, name) {
  const url = URL.createObjectURL(blob);
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

/** @type {Map<string, string>} */
const colours = new Map();

/** The colours are others now. */
export const forgetColours = () => colours.clear();

/** A colour of the style sheet as it is now. @param {string} name */
export function colour(name) {
  const known = colours.get(name);
  if (known) return known;
  const probe = h("span", { hidden: false });
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const value = getComputedStyle(probe).color;
  probe.remove();
  colours.set(name, value);
  return value;
}
