// A layout in the view: curves as ribbons, nodes as dots, found patches as tinted surfaces, faults marked.

import { Vector3 } from "three";

import { colour } from "../core/dom.js";
import { patchTint } from "../view/colours.js";
import { toVector } from "../view/stage.js";
import { toScene } from "./window.js";

/** @import { Curve, Layout } from "../../js/types.js" */
/** @import { Stage } from "../view/stage.js" */

const STEPS = 14;

/**
 * @param {Stage} stage
 * @param {Layout} layout
 * @param {Set<number>} chosen ids of curves
 */
export function drawLayout(stage, layout, chosen) {
  const [ink, accent, fault] = ["--ink", "--accent", "--fault"].map((name) => toVector(colour(name)));
  const byId = new Map(layout.curves.map((curve) => [curve.id, curve]));
  stage.setOverlay({
    fills: layout.patches.flatMap((ids, place) => {
      const sides = ids.map((id) => byId.get(id)).filter((curve) => curve !== undefined);
      const tint = patchTint(place).map((value) => value / 255);
      return sides.length === 4 ? [{ triangles: fillPatch(stage, sides), colour: new Vector3(...tint), opacity: 0.55, lift: 0.012 }] : [];
    }),
    ribbons: layout.curves.map((curve) => ({
      points: toScene(stage, curve.points), colour: chosen.has(curve.id) ? accent : ink, width: chosen.has(curve.id) ? 3.5 : 2 })),
    dots: [
      ...layout.nodes.map((node) => ({ point: stage.toScene(node), colour: ink, size: 10 })),
      ...layout.issues.map(({ point }) => ({ point: stage.toScene(point), colour: fault, size: 13 })),
    ],
  });
}

/**
 * The bilinearly blended Coons patch of four curves (Coons 1967), as triangles of the scene.
 * @param {Stage} stage
 * @param {Curve[]} curves in turn round the patch
 */
function fillPatch(stage, curves) {
  const sides = orient(curves).map((points) => resample(toScene(stage, points), STEPS));
  const [bottom, right, top, left] = [sides[0], sides[1], sides[2].reverse(), sides[3].reverse()];
  const at = (/** @type {number} */ i, /** @type {number} */ j) => {
    const [u, v] = [i / STEPS, j / STEPS];
    return new Vector3()
      .addScaledVector(bottom[i], 1 - v).addScaledVector(top[i], v).addScaledVector(left[j], 1 - u).addScaledVector(right[j], u)
      .addScaledVector(bottom[0], -(1 - u) * (1 - v)).addScaledVector(bottom[STEPS], -u * (1 - v))
      .addScaledVector(top[0], -(1 - u) * v).addScaledVector(top[STEPS], -u * v);
  };
  const triangles = new Float32Array(18 * STEPS * STEPS);
  let place = 0;
  for (let i = 0; i < STEPS; i++) {
    for (let j = 0; j < STEPS; j++) {
      for (const [di, dj] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) at(i + di, j + dj).toArray(triangles, 3 * place++);
    }
  }
  return triangles;
}

/** The curves' points so that each begins where the one before ends. @param {Curve[]} curves */
function orient(curves) {
  const [first, second] = curves;
  let node = [second.from, second.to].includes(first.to) ? first.from : first.to;
  return curves.map(({ from, to, points }) => {
    const isForth = from === node;
    node = isForth ? to : from;
    return isForth ? points : [...points].reverse();
  });
}

/** Points at equal lengths along a polyline. @param {Vector3[]} points @param {number} steps */
function resample(points, steps) {
  const lengths = [0];
  for (let i = 1; i < points.length; i++) lengths.push(lengths[i - 1] + points[i].distanceTo(points[i - 1]));
  const total = lengths[lengths.length - 1];
  let piece = 0;
  return Array.from({ length: steps + 1 }, (_, i) => {
    const wanted = (total * i) / steps;
    while (piece + 2 < points.length && lengths[piece + 1] < wanted) piece++;
    const span = lengths[piece + 1] - lengths[piece];
    return points[piece].clone().lerp(points[piece + 1], span > 0 ? Math.min(1, (wanted - lengths[piece]) / span) : 0);
  });
}
