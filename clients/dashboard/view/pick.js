// Where rays first meet a model, and its place nearest to a point: by a tree over each of its pieces, made by a worker.

import { Raycaster, Vector2, Vector3 } from "three";
import { MeshBVH } from "three-mesh-bvh";

import { keptPart } from "./plane.js";

/** @import { BufferGeometry, Ray } from "three" */
/** @import { Model } from "./model.js" */
/** @import { Stage } from "./stage.js" */

/** The trees, by the positions that they are over: a piece that moved gets another. @type {WeakMap<object, MeshBVH>} */
const trees = new WeakMap();
/** @type {Worker | undefined} */
let worker;
/** @type {Map<number, (tree: any) => void>} */
const waiting = new Map();
let nextRequest = 1;

function start() {
  worker = new Worker(new URL("./trees.js", import.meta.url), { type: "module" });
  worker.addEventListener("message", ({ data: { request, tree } }) => {
    waiting.get(request)?.(tree);
    waiting.delete(request);
  });
  return worker;
}

/** @param {BufferGeometry} geometry */
function treeOf(geometry) {
  const position = geometry.getAttribute("position");
  let tree = trees.get(position);
  if (!tree) {
    tree = new MeshBVH(geometry, { indirect: true });
    trees.set(position, tree);
  }
  return tree;
}

/** Has the trees of a model made by the worker, before they are needed. @param {Model} model */
export async function prepare(model) {
  await Promise.all(model.pieces.map(async ({ geometry }) => {
    const position = geometry.getAttribute("position");
    if (trees.has(position)) return;
    const request = nextRequest++;
    const made = new Promise((resolve) => { waiting.set(request, resolve); });
    (worker ?? start()).postMessage({ request, position: position.array });
    const tree = await made;
    if (!trees.has(position)) trees.set(position, MeshBVH.deserialize(tree, geometry, { setIndex: false }));
  }));
}

/**
 * Where a ray first meets a model, in the model's own numbers.
 * @param {Model} model
 * @param {Ray} ray in the scene
 */
function firstHit(model, ray) {
  model.group.updateMatrixWorld();
  const own = ray.clone().applyMatrix4(model.group.matrixWorld.clone().invert());
  const [near, far] = keptPart(model.plane, ray).map((distance) => distance / model.group.scale.x);
  let nearest = Infinity;
  /** @type {{ point: Vector3, normal: Vector3 } | null} */
  let found = null;
  for (const piece of model.pieces) {
    const hit = treeOf(piece.geometry).raycastFirst(own, 2, near, far);
    if (!hit || hit.distance >= nearest) continue;
    nearest = hit.distance;
    found = { point: hit.point, normal: hit.face?.normal.clone() ?? new Vector3(0, 0, 1) };
  }
  return found;
}

/** How far along a ray of the scene a model is first met. @param {Model} model @param {Ray} ray */
export function rayHits(model, ray) {
  const hit = firstHit(model, ray);
  return hit ? hit.point.applyMatrix4(model.group.matrixWorld).distanceTo(ray.origin) : Infinity;
}

/**
 * The face of a model that is nearest to a point of the scene: its distance there, and its normal.
 * @param {Model} model
 * @param {Vector3} point
 * @returns {{ distance: number, normal: Vector3 } | null}
 */
export function nearestOn(model, point) {
  model.group.updateMatrixWorld();
  const own = point.clone().applyMatrix4(model.group.matrixWorld.clone().invert());
  let nearest = Infinity;
  let normal = null;
  for (const { geometry } of model.pieces) {
    const found = treeOf(geometry).closestPointToPoint(own, undefined, 0, nearest);
    if (!found || found.distance >= nearest) continue;
    nearest = found.distance;
    const position = geometry.getAttribute("position");
    const [a, b, c] = [0, 1, 2].map((k) => new Vector3().fromBufferAttribute(position, 3 * found.faceIndex + k));
    normal = b.sub(a).cross(c.sub(a)).normalize();
  }
  return normal && normal.lengthSq() > 0 ? { distance: nearest * model.group.scale.x, normal } : null;
}

/**
 * @param {Stage} stage
 * @param {Model} model
 * @param {number} x of the window, from the view's left edge
 * @param {number} y from its top
 * @returns {{ point: number[], normal: number[] } | null} in the mesh's own space
 */
export function pick(stage, model, x, y) {
  const { clientWidth: width, clientHeight: height } = stage.canvas;
  const caster = new Raycaster();
  stage.eye.camera.updateMatrixWorld();
  caster.setFromCamera(new Vector2((2 * x) / width - 1, 1 - (2 * y) / height), stage.eye.camera);
  const found = firstHit(model, caster.ray);
  if (!found) return null;
  const { centre, scale } = model.frame;
  return { point: found.point.toArray().map((value, k) => value / scale + centre[k]), normal: found.normal.toArray() };
}
