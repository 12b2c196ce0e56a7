// How A is moved, on the screen and in all that is asked of it.

import { parameter, setParameters } from "../core/route.js";
import { state } from "../core/state.js";

/** @import { MeshName, Transform } from "../../js/types.js" */

/** Of a matrix, all but the last row. */
const ROWS = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14];

/** @type {{ transform: Transform | null }} as it was left */
export const pose = { transform: null };

/** @param {Transform} transform for a link */
export const textOfPose = (transform) => ROWS.map((place) => transform[place]).join();

/** Takes up what the address says. */
export function readPose() {
  const numbers = (parameter("pose") ?? "").split(",").map(Number);
  const isPose = numbers.length === ROWS.length && numbers.every(Number.isFinite);
  pose.transform = isPose ? [0, 1, 2, 3].flatMap((column) => [...numbers.slice(3 * column, 3 * column + 3), column === 3 ? 1 : 0]) : null;
}

/** @param {Transform | null} transform */
export function setPose(transform) {
  pose.transform = transform;
  setParameters({ pose: transform && textOfPose(transform) });
}

/** A as a request names it. @returns {MeshName} */
export const moved = () => (pose.transform ? { mesh: /** @type {string} */ (state.a), transform: pose.transform } : /** @type {string} */ (state.a));

/** Is a request about A as it is now? @param {MeshName | undefined} name */
export function isMoved(name) {
  const [mesh, transform] = typeof name === "object" ? [name.mesh, name.transform] : [name, null];
  return mesh === state.a && JSON.stringify(transform) === JSON.stringify(pose.transform);
}
