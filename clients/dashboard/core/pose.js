// How A is moved, on the screen and in all that is asked of it.

import { setParameters } from "./route.js";
import { state } from "./state.js";

/** @import { MeshName, Transform } from "../../js/types.js" */

/** Of a matrix, all but the last row. */
const ROWS = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14];

/** @param {Transform} transform for a link */
export const textOfPose = (transform) => ROWS.map((place) => transform[place]).join();

/** How A is moved; null: it lies where its file has it. Another A lies where it is. @returns {Transform | null} */
export function poseOfA() {
  if (!state.pose?.text || state.pose.mesh !== state.a) return null;
  const numbers = state.pose.text.split(",").map(Number);
  if (numbers.length !== ROWS.length || !numbers.every(Number.isFinite)) return null;
  return [0, 1, 2, 3].flatMap((column) => [...numbers.slice(3 * column, 3 * column + 3), column === 3 ? 1 : 0]);
}

/** @param {Transform | null} transform */
export function keepPose(transform) {
  state.pose = { mesh: state.a, text: transform && textOfPose(transform) };
}

/** Says in the address how A is moved. */
export function setPoseParameter() {
  const transform = poseOfA();
  setParameters({ pose: transform && textOfPose(transform) });
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
