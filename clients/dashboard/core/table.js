// Tables of figures, each row with its name.

import { h } from "./dom.js";
import { intervals } from "./format.js";

/** @import { Interval } from "../../js/types.js" */

/**
 * One that can be scrolled where it is wider than its place.
 * @param {string} caption
 * @param {string[]} heads of the columns
 * @param {[string | HTMLElement, string[]][]} rows
 */
export function makeTable(caption, heads, rows) {
  return h("div", { className: "scroll", tabIndex: 0, role: "group", "aria-label": caption }, h("table", { className: "figures-table" },
    h("caption", { className: "unseen" }, caption),
    h("thead", {}, h("tr", {}, h("td", {}), ...heads.map((head) => h("th", { scope: "col", className: "number" }, head)))),
    h("tbody", {}, ...rows.map(([name, cells]) => h("tr", {}, h("th", { scope: "row" }, name), ...cells.map((cell) => h("td", { className: "number" }, cell)))))));
}

/**
 * Rows of intervals, all written alike; where there is none the cell stays empty.
 * @param {[string, (Interval | null)[]][]} rows
 * @param {number} [finest] share of a figure below which no digits are wanted
 * @returns {[string, string[]][]}
 */
export function writeRows(rows, finest = 0) {
  const written = intervals(rows.flatMap(([, cells]) => cells.flatMap((cell) => cell ?? [])), finest);
  return rows.map(([name, cells]) => [name, cells.map((cell) => (cell === null ? "" : /** @type {string} */ (written.shift())))]);
}
