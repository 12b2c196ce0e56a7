// A layout in the view: curves as ribbons, nodes as dots, faults marked, and the surface shaded where patches are closed.

import { colour } from "../core/dom.js";
import { patchTint } from "../view/colours.js";
import { colourRegions } from "../view/loader.js";
import { toVector } from "../view/stage.js";
import { toScene } from "./window.js";

/** @import { Curve, Layout, LayoutSuggestion } from "../../js/types.js" */
/** @import { Plan } from "../view/regions.js" */
/** @import { Stage } from "../view/stage.js" */

const MARKED_WIDTH = 5;

/**
 * Sharp curves are drawn thick, fixed ones thick and pale; corners are large dots.
 * @param {Stage} stage
 * @param {Layout} layout
 * @param {Set<number>} chosen ids of curves; the ends of one that is chosen alone can be held
 * @param {LayoutSuggestion[]} suggested
 */
export function drawLayout(stage, layout, chosen, suggested) {
  const [ink, accent, fault, muted] = ["--ink", "--accent", "--fault", "--muted"].map((name) => toVector(colour(name)));
  const grips = chosen.size === 1 ? layout.curves.filter(({ id }) => chosen.has(id)).flatMap(({ from, to }) => [from, to]) : [];
  stage.setOverlay({
    isOverCloud: stage.models.get("a")?.mesh.kind === "points",
    ribbons: [...layout.curves.map((curve) => ({
      points: toScene(stage, curve.points), colour: chosen.has(curve.id) ? accent : curve.mark === "fixed" ? muted : ink,
      width: curve.mark ? MARKED_WIDTH : chosen.has(curve.id) ? 4 : 2.25 })),
    ...suggested.map(({ points }) => ({ points: toScene(stage, points), colour: accent, width: 1.5 }))],
    dots: [
      ...layout.nodes.map((node, place) => ({
        point: stage.toScene(node), colour: grips.includes(place) ? accent : ink, size: grips.includes(place) || layout.corners?.includes(place) ? 15 : 10 })),
      ...layout.issues.map(({ point }) => ({ point: stage.toScene(point), colour: fault, size: 13, isMark: true })),
    ],
  });
}

/** The tints of patches, by their curves: one that stays keeps its own. @type {Map<string, number[]>} */
const tints = new Map();

/** @param {number[]} sides */
function tintOf(sides) {
  const key = [...sides].sort((a, b) => a - b).join();
  const tint = tints.get(key) ?? patchTint(tints.size);
  tints.set(key, tint);
  return tint;
}

/** Shades what lies in the patches of a layout. @param {Stage} stage @param {Layout} layout */
export async function shadePatches(stage, layout) {
  const model = stage.models.get("a");
  if (!model?.isWhole) return;
  const byId = new Map(layout.curves.map((curve) => [curve.id, curve]));
  /** @type {Plan["patches"]} */
  const patches = layout.patches.map((sides) => ({
    sides, tint: tintOf(sides), middle: middleOf(sides.flatMap((id) => byId.get(id) ?? [])) }));
  if (patches.length === 0) model.setRegions(null);
  else await colourRegions(model, { curves: layout.curves.map(({ id, points }) => ({ id, points })), patches });
  stage.draw();
}

/** The middle of the Coons patch of four curves (Coons 1967). @param {Curve[]} sides */
function middleOf(sides) {
  const sum = [0, 0, 0];
  const add = (/** @type {number[]} */ point, /** @type {number} */ weight) => point.forEach((value, k) => { sum[k] += weight * value; });
  for (const { points } of sides) {
    add(points[Math.floor(points.length / 2)], 1 / 2);
    add(points[0], -1 / 8);
    add(points[points.length - 1], -1 / 8);
  }
  return sum;
}
