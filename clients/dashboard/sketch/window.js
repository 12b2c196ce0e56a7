// Between the window and the mesh's own space, for strokes, clicks and snapping. Only what is seen can be met.

import { Matrix4 } from "three";

import { pick } from "../view/pick.js";

/** @import { Vector3 } from "three" */
/** @import { Curve, Layout, Point, Stroke } from "../../js/types.js" */
/** @import { Stage } from "../view/stage.js" */
/** @import { Track } from "./pen.js" */
/** @typedef {(place: Vector3) => boolean} IsSeen of a place in the scene */
/** @typedef {{ kind: "node" | "curve", point: Point, x: number, y: number }} Target where an end would go */

const CLICK_REACH = 12;
const SNAP_REACH = 12;

/** A stroke as the daemon takes it. @param {Stage} stage @param {Track} track @returns {Stroke} */
export function strokeOf(stage, track) {
  const { eye: { camera }, frame: { centre, scale }, canvas } = stage;
  camera.updateMatrixWorld();
  const [x, y, z] = centre.map((value) => -value * scale);
  const view = camera.matrixWorldInverse.clone().multiply(new Matrix4().makeScale(scale, scale, scale).setPosition(x, y, z));
  return {
    points: track, view: view.toArray(), projection: camera.projectionMatrix.toArray(),
    viewport: [0, 0, canvas.clientWidth, canvas.clientHeight],
  };
}

/** Where a point is in the window. @param {Stage} stage @param {number[]} point @returns {[number, number]} */
export function toWindow(stage, point) {
  const place = stage.toScene(point).project(stage.eye.camera);
  return [((place.x + 1) / 2) * stage.canvas.clientWidth, ((1 - place.y) / 2) * stage.canvas.clientHeight];
}

/** How many pixels a length of 1 in the mesh's own unit has at a distance from the eye. @param {Stage} stage @param {number} depth */
const pixelsPerUnit = (stage, depth) =>
  (stage.frame.scale * stage.canvas.clientHeight * stage.eye.camera.projectionMatrix.elements[5]) / (2 * depth);

/** A length at a point in pixels. @param {Stage} stage @param {number[]} point @param {number} size in the mesh's own unit */
const toPixels = (stage, point, size) => size * pixelsPerUnit(stage, stage.toScene(point).distanceTo(stage.eye.camera.position));

/**
 * How far in the mesh's own unit an end snaps that is put at a place of the window: SNAP_REACH pixels of what is seen there, however
 * near the eye is.
 * @param {Stage} stage @param {number} x @param {number} y
 */
export function snapRadius(stage, x, y) {
  const { camera, controls } = stage.eye;
  const model = stage.models.get("a");
  const found = model?.isWhole && model.mesh.kind !== "points" ? pick(stage, model, x, y) : null;
  const depth = (found ? stage.toScene(found.point) : controls.target).distanceTo(camera.position);
  return SNAP_REACH / pixelsPerUnit(stage, depth);
}

/**
 * The seen curve nearest to a place of the window, and its point there.
 * @param {Stage} stage
 * @param {Curve[]} curves
 * @param {number} x
 * @param {number} y
 * @param {IsSeen} isSeen
 * @param {(point: Point) => number} [reach] in pixels
 * @returns {{ curve: Curve, point: Point } | null}
 */
export function curveAt(stage, curves, x, y, isSeen, reach = () => CLICK_REACH) {
  let best = Infinity;
  let found = null;
  for (const curve of curves) {
    const track = curve.points.map((point) => toWindow(stage, point));
    for (let i = 0; i + 1 < track.length; i++) {
      const [[x0, y0], [x1, y1]] = [track[i], track[i + 1]];
      const square = (x1 - x0) ** 2 + (y1 - y0) ** 2;
      const share = square > 0 ? Math.max(0, Math.min(1, ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / square)) : 0;
      const away = Math.hypot(x0 + share * (x1 - x0) - x, y0 + share * (y1 - y0) - y);
      if (away >= best) continue;
      const point = /** @type {Point} */ (curve.points[i].map((value, k) => value + share * (curve.points[i + 1][k] - value)));
      if (away > reach(point) || !isSeen(stage.toScene(point))) continue;
      best = away;
      found = { curve, point };
    }
  }
  return found;
}

/**
 * What an end at a place of the window would snap to: a node, else a curve.
 * @param {Stage} stage
 * @param {Layout} layout
 * @param {number} x
 * @param {number} y
 * @param {number} radius in the mesh's own unit
 * @param {IsSeen} isSeen
 * @returns {Target | null}
 */
export function targetAt(stage, layout, x, y, radius, isSeen) {
  let best = Infinity;
  /** @type {Target | null} */
  let found = null;
  const reach = (/** @type {number[]} */ point) => Math.max(4, toPixels(stage, point, radius));
  for (const node of layout.nodes) {
    const [nx, ny] = toWindow(stage, node);
    const away = Math.hypot(nx - x, ny - y);
    if (away >= best || away > reach(node) || !isSeen(stage.toScene(node))) continue;
    best = away;
    found = { kind: "node", point: node, x: nx, y: ny };
  }
  const on = found ? null : curveAt(stage, layout.curves, x, y, isSeen, reach);
  if (!on) return found;
  const [cx, cy] = toWindow(stage, on.point);
  return { kind: "curve", point: on.point, x: cx, y: cy };
}

/** @param {Stage} stage @param {Point[]} points */
export const toScene = (stage, points) => points.map((point) => stage.toScene(point));
