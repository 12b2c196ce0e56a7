// Looks at a place from where it is sure to be seen: a ray from the eye meets it before anything else.

import { Ray, Vector3 } from "three";

import { nearestOn, prepare, rayHits } from "./pick.js";

/** @import { Model } from "./model.js" */
/** @import { Stage } from "./stage.js" */
/** @typedef {"seen" | "partly" | "hidden"} Sight all points are seen, the first one is, or no side shows it: the view is see-through then */

/** Directions that are tried when the near ones do not show the place. */
const DIRECTIONS = 128;
/** Shares of the wanted distance: in a hollow the eye has to come nearer. */
const NEARER = [1, 0.5, 0.25, 0.1, 0.04];
/** How far before the place a ray may end that counts as having met it, as a share of the way, for the numbers of the graphics card. */
const SLACK = 1e-3;
/** Sines of angles with the surface: below the first a place is seen where no other side shows it, below the second it is not seen. */
const GOOD_SLOPE = 0.25;
const LEAST_SLOPE = 0.1;

/**
 * Flies to where points are seen. The first one must be; the others are where there is a choice.
 * @param {Stage} stage
 * @param {Vector3[]} points in the scene
 * @param {number} distance of the eye
 * @returns {Promise<Sight>}
 */
export async function lookAt(stage, points, distance) {
  const opaque = stage.opaqueModels();
  await Promise.all(opaque.map(prepare));
  const target = points.reduce((sum, point) => sum.add(point), new Vector3()).divideScalar(points.length);
  const { outer, inner, normal } = sidesFirst(stage, opaque, points[0], target);
  const found = findPlace(opaque, points, target, distance, { directions: outer, normal })
    ?? findPlace(opaque, points, target, distance, { directions: inner, normal });
  const sight = found === null ? "hidden" : found.seen === points.length ? "seen" : "partly";
  stage.setThrough(sight === "hidden");
  const eye = found?.eye ?? target.clone().addScaledVector(stage.eye.camera.position.clone().sub(target).normalize(), distance);
  const [reach, side] = [eye.distanceTo(target), eye.clone().sub(target)];
  stage.eye.flyTo(target, reach, side);
  return sight;
}

/** What to say of a sight that is not whole. @param {Sight} sight @param {string} what such as "the contact" */
export function wordsOf(sight, what) {
  if (sight === "hidden") return `No side shows ${what}: the surfaces are drawn see-through.`;
  return sight === "partly" ? `A part of ${what} lies behind the surface: hollow marks are hidden ones.` : "";
}

/**
 * Directions from a place to the eye, the best first: along the surface's normal, whence one looks now, away from the middle, then
 * all round, those near these before the others. Of a place on a closed surface those that lead inside are for want of others: from
 * there it is seen, too, but not as one knows it.
 * @param {Stage} stage
 * @param {Model[]} models
 * @param {Vector3} point
 * @param {Vector3} target
 */
function sidesFirst(stage, models, point, target) {
  const now = stage.eye.camera.position.clone().sub(target).normalize();
  const { normal, isOutward } = normalAt(models, point);
  const outward = target.lengthSq() > 1e-6 ? target.clone().normalize() : now;
  const first = normal ? [normal.dot(now) < 0 && !isOutward ? normal.clone().negate() : normal.clone()] : [];
  if (normal) first.push(first[0].clone().negate());
  const best = first[0] ?? now;
  const all = Array.from({ length: DIRECTIONS }, (_, n) => onSphere(n, DIRECTIONS))
    .sort((one, other) => other.dot(best) - one.dot(best));
  const directions = [...first, now, outward, ...all];
  const leadsOut = (/** @type {Vector3} */ direction) => !isOutward || !normal || normal.dot(direction) > 0;
  return { outer: directions.filter(leadsOut), inner: directions.filter((direction) => !leadsOut(direction)), normal };
}

/** Directions that are spread evenly over the sphere (Fibonacci's lattice). @param {number} n @param {number} count */
function onSphere(n, count) {
  const z = 1 - (2 * n + 1) / count;
  const turn = n * Math.PI * (3 - Math.sqrt(5));
  const radius = Math.sqrt(1 - z * z);
  return new Vector3(radius * Math.cos(turn), radius * Math.sin(turn), z);
}

/** The normal of the face that a point lies on; outward where the surface is closed. @param {Model[]} models @param {Vector3} point */
function normalAt(models, point) {
  let least = Infinity;
  /** @type {Vector3 | null} */
  let normal = null;
  let isOutward = false;
  for (const model of models) {
    const found = nearestOn(model, point);
    if (!found || found.distance >= least) continue;
    const { watertight, volume } = model.mesh;
    least = found.distance;
    isOutward = watertight === true && Boolean(volume);
    normal = isOutward && (volume?.upper ?? 0) < 0 ? found.normal.negate() : found.normal;
  }
  return { normal, isOutward };
}

/**
 * @param {Model[]} models
 * @param {Vector3[]} points
 * @param {Vector3} target
 * @param {number} distance
 * @param {{ directions: Vector3[], normal: Vector3 | null }} sides
 * @returns {{ eye: Vector3, seen: number } | null}
 */
function findPlace(models, points, target, distance, { directions, normal }) {
  /** @type {{ eye: Vector3, seen: number, slope: number } | null} */
  let best = null;
  for (const share of NEARER) {
    for (const direction of directions) {
      const slope = normal ? Math.abs(normal.dot(direction)) : 1;
      if (slope < LEAST_SLOPE) continue;
      const eye = target.clone().addScaledVector(direction, share * distance);
      if (!isSeen(models, eye, points[0])) continue;
      const seen = points.filter((point) => isSeen(models, eye, point)).length;
      if (seen === points.length && slope >= GOOD_SLOPE) return { eye, seen };
      if (!best || seen > best.seen || (seen === best.seen && slope > 2 * best.slope)) best = { eye, seen, slope };
    }
    if (best && best.slope >= GOOD_SLOPE) return best;
  }
  return best;
}

/** Does a ray from the eye meet a point before anything else? @param {Model[]} models @param {Vector3} eye @param {Vector3} point */
export function isSeen(models, eye, point) {
  const away = point.clone().sub(eye);
  const reach = away.length();
  const ray = new Ray(eye.clone(), away.divideScalar(reach));
  return models.every((model) => rayHits(model, ray) >= reach * (1 - SLACK));
}
