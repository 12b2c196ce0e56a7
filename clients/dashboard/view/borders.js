// The edges round a set of triangles: those that one of them has alone.

import { Vector3 } from "three";

/** @param {Float32Array} triangles nine numbers each @returns {[Vector3, Vector3][]} */
export function bordersOf(triangles) {
  /** @type {Map<string, [Vector3, Vector3]>} */
  const once = new Map();
  for (let at = 0; at < triangles.length; at += 9) {
    for (let k = 0; k < 3; k++) {
      const [from, to] = [at + 3 * k, at + 3 * ((k + 1) % 3)].map((place) => triangles.subarray(place, place + 3).join());
      const key = from < to ? `${from} ${to}` : `${to} ${from}`;
      if (once.has(key)) once.delete(key);
      else once.set(key, [new Vector3().fromArray(triangles, at + 3 * k), new Vector3().fromArray(triangles, at + 3 * ((k + 1) % 3))]);
    }
  }
  return [...once.values()];
}
