// Pairs of faces that meet, in the view: all of them lightly, the one that is looked at strongly, with the normals of its faces.

import { colour } from "../core/dom.js";
import { outline } from "../view/loader.js";
import { toVector } from "../view/stage.js";

/** @import { CollisionPair } from "../../js/types.js" */
/** @import { Stage } from "../view/stage.js" */

/** How long normals are drawn, as a share of the first mesh's diagonal. */
const NORMAL_LENGTH = 0.06;

/**
 * @param {Stage} stage
 * @param {{ pairs: Float64Array, isSelf: boolean, current: CollisionPair | null }} found
 */
export async function drawContacts(stage, { pairs, isSelf, current }) {
  const a = stage.models.get("a");
  const b = isSelf ? a : stage.models.get("b");
  if (!a?.isWhole || !b?.isWhole) return;
  const faces = [new Set(), new Set()];
  pairs.forEach((face, place) => faces[isSelf ? 0 : place % 2].add(face));
  const ask = (/** @type {typeof a} */ model, /** @type {Iterable<number>} */ of) => outline(model, of, stage.frame);
  const [allA, allB, oneA, oneB] = await Promise.all([
    ask(a, faces[0]), ask(b, faces[1]), ask(a, current ? [current.faces[0]] : []), ask(b, current ? [current.faces[1]] : [])]);
  const [strong, light] = [toVector(colour("--fault")), toVector(colour("--upper"))];
  const points = (current?.points ?? []).map((point) => stage.toScene(point));
  const normals = current ? normalsOf(stage, current, isSelf) : [];
  stage.setOverlay({
    fills: [{ triangles: allA, colour: light, opacity: 0.35 }, { triangles: allB, colour: light, opacity: 0.35 },
      { triangles: oneA, colour: strong, opacity: 0.9 }, { triangles: oneB, colour: strong, opacity: 0.9 }],
    ribbons: [...points.length > 1 ? [{ points, colour: strong, width: 2.5 }] : [], ...normals.map((normal) => ({ ...normal, width: 2.5 }))],
    dots: [...points.map((point) => ({ point, colour: strong, size: 11, isMark: true })),
      ...normals.map(({ points: [, tip], colour: tint }) => ({ point: tip, colour: tint, size: 8, isMark: true }))],
  });
}

/** From the middle of a contact along the normal of either face, in the colour of its mesh. @param {Stage} stage @param {CollisionPair} pair @param {boolean} isSelf */
function normalsOf(stage, { points, normals }, isSelf) {
  const ends = points.map((point) => stage.toScene(point));
  const foot = ends[0].clone().lerp(/** @type {typeof ends[0]} */ (ends.at(-1)), 0.5);
  return normals.filter((normal) => normal.some((x) => x !== 0)).map((normal, place) => ({
    points: [foot, foot.clone().add(stage.toScene(normal).sub(stage.toScene([0, 0, 0])).setLength(NORMAL_LENGTH))],
    colour: toVector(colour(place === 0 || isSelf ? "--mesh-a" : "--mesh-b")) }));
}
