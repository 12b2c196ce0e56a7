// On which side of a solid the points of a surface lie, proven: a triangle that is surely away from the solid's surface lies on one side
// as a whole, and all that are connected by such triangles with it; which one, the winding number of one of their points tells.

/** @import { Refined } from "./refine.js" */
/** @import { Winding } from "./winding.js" */

/** Points of one part whose winding number is asked for, where that of the first one is not known. */
const MOST_ASKED = 8;

/**
 * @param {Refined} refined
 * @param {Winding} winding of the solid
 * @returns {Int8Array} of the points: 1 outside, -1 inside, 0 on the surface, or not known
 */
export function provenSides(refined, winding) {
  const { points, corners, feet: { distance } } = refined;
  const { slack } = refined;
  const count = points.length / 3;
  const parent = Uint32Array.from({ length: count }, (_, n) => n);
  const rootOf = (/** @type {number} */ n) => {
    while (parent[n] !== n) n = parent[n] = parent[parent[n]];
    return n;
  };
  for (let t = 0; t < refined.count; t++) {
    if (!refined.isClear(t, slack)) continue;
    const root = rootOf(corners[3 * t]);
    parent[rootOf(corners[3 * t + 1])] = root;
    parent[rootOf(corners[3 * t + 2])] = root;
  }
  /** Points of each part, among them the farthest ones, whose winding numbers are known best. @type {Map<number, number[]>} */
  const parts = new Map();
  for (let n = 0; n < count; n++) {
    if (distance[n] <= slack) continue;
    const root = rootOf(n);
    const list = parts.get(root);
    if (!list) parts.set(root, [n]);
    else if (list.length < MOST_ASKED) list.push(n);
    else if (distance[n] > distance[list[0]]) [list[0], list[1]] = [n, list[0]];
  }
  const sides = new Int8Array(count);
  for (const [root, list] of parts) {
    for (const n of list) {
      const found = winding.of(points.subarray(3 * n, 3 * n + 3));
      if (found === null) continue;
      sides[root] = found === 0 ? 1 : -1;
      break;
    }
  }
  for (let n = 0; n < count; n++) sides[n] = distance[n] <= slack ? 0 : sides[rootOf(n)];
  return sides;
}
