// Bands of signed distances about the limits: what the daemon is asked, and its shares in words.

import { shareBetween } from "../core/format.js";
import { wanted } from "./range.js";

/** @import { SignedDeviation } from "../../js/types.js" */
/** @import { Sign } from "./sign.js" */
/** @typedef {[number | null, number | null][]} Bands */

/** The sign that a question asks for, with the bands below, within and beyond the limits where there are some. @param {Sign} sign @returns {{ sign?: Sign, bands?: Bands }} */
export function bandsOf(sign) {
  if (sign === "none") return {};
  if (!wanted.limits) return { sign };
  const [low, high] = wanted.limits;
  return { sign, bands: [[null, low], [low, high], [high, null]] };
}

/** @param {{ from: number | null, to: number | null }} band */
function nameOf({ from, to }) {
  if (from === null) return `Share below ${to}`;
  return to === null ? `Share above ${from}` : `Share from ${from} to ${to}`;
}

/**
 * A row for each band, with a cell for each direction.
 * @param {(SignedDeviation | undefined)[]} directions
 * @returns {[string, string[]][]}
 */
export function bandRows(directions) {
  const [first] = directions;
  return (first?.bands ?? []).map((band, place) => [nameOf(band), directions.map((signed) => (signed ? shareBetween(signed.bands[place]) : "–"))]);
}
