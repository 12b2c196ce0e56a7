// How A is moved, on the screen and in all that is asked of it.

import { state } from "./state.js";

/** @import { MeshName, Transform } from "../../js/types.js" */

/** Of a matrix, all but the last row. */
const ROWS = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14];

/** @type {{ transform: Transform | null, mesh: string | null }} of which mesh, since another A lies where it is */
const kept = { transform: null, mesh: null };

/** @param {Transform} transform for a link */
export const textOfPose = (transform) => ROWS.map((place) => transform[place]).join();

/** How A is moved; null: it lies where its file has it. */
export const poseOfA = () => (kept.mesh === state.a ? kept.transform : null);

/** @param {Transform | null} transform */
export function keepPose(transform) {
  Object.assign(kept, { transform, mesh: state.a });
}

/** Takes up what an address says. @param {string | null} text */
export function readPose(text) {
  const numbers = (text ?? "").split(",").map(Number);
  const isPose = numbers.length === ROWS.length && numbers.every(Number.isFinite);
  keepPose(isPose ? [0, 1, 2, 3].flatMap((column) => [...numbers.slice(3 * column, 3 * column + 3), column === 3 ? 1 : 0]) : null);
}

/** A as a request names it. @returns {MeshName} */
export function moved() {
  const transform = poseOfA();
  const mesh = /** @type {string} */ (state.a);
  return transform ? { mesh, transform } : mesh;
}

/** Is a request about A as it is now? @param {MeshName | undefined} name */
export function isMoved(name) {
  const [mesh, transform] = typeof name === "object" ? [name.mesh, name.transform] : [name, null];
  return mesh === state.a && JSON.stringify(transform) === JSON.stringify(poseOfA());
}
