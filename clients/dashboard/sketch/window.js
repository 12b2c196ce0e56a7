// Between the window and the mesh's own space, for strokes, clicks and snapping.

import { Matrix4 } from "three";

/** @import { Curve, Point, Stroke } from "../../js/types.js" */
/** @import { Stage } from "../view/stage.js" */
/** @import { Track } from "./pen.js" */

/** A stroke as the daemon takes it. @param {Stage} stage @param {Track} track @returns {Stroke} */
export function strokeOf(stage, track) {
  const { eye: { camera }, frame: { centre, scale }, canvas } = stage;
  camera.updateMatrixWorld();
  const toScene = new Matrix4().makeScale(scale, scale, scale).setPosition(...centreOf(centre, scale));
  const view = camera.matrixWorldInverse.clone().multiply(toScene);
  return {
    points: track, view: view.toArray(), projection: camera.projectionMatrix.toArray(),
    viewport: [0, 0, canvas.clientWidth, canvas.clientHeight],
  };
}

/** @param {number[]} centre @param {number} scale @returns {[number, number, number]} */
const centreOf = (centre, scale) => [-centre[0] * scale, -centre[1] * scale, -centre[2] * scale];

/** Where a point is in the window. @param {Stage} stage @param {number[]} point @returns {[number, number]} */
export function toWindow(stage, point) {
  const place = stage.toScene(point).project(stage.eye.camera);
  return [((place.x + 1) / 2) * stage.canvas.clientWidth, ((1 - place.y) / 2) * stage.canvas.clientHeight];
}

/**
 * The curve nearest to a place of the window, and its point there.
 * @param {Stage} stage
 * @param {Curve[]} curves
 * @param {number} x
 * @param {number} y
 * @param {number} reach in pixels
 * @returns {{ curve: Curve, point: Point } | null}
 */
export function curveAt(stage, curves, x, y, reach = 12) {
  let best = reach;
  let nearest = Infinity;
  let found = null;
  for (const curve of curves) {
    for (let i = 0; i + 1 < curve.points.length; i++) {
      const [[x0, y0], [x1, y1]] = [toWindow(stage, curve.points[i]), toWindow(stage, curve.points[i + 1])];
      const square = (x1 - x0) ** 2 + (y1 - y0) ** 2;
      const share = square > 0 ? Math.max(0, Math.min(1, ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / square)) : 0;
      const away = Math.hypot(x0 + share * (x1 - x0) - x, y0 + share * (y1 - y0) - y);
      if (away > reach) continue;
      const point = /** @type {Point} */ (curve.points[i].map((value, k) => value + share * (curve.points[i + 1][k] - value)));
      // Of curves that lie over each other in the window, the one in front.
      const depth = stage.toScene(point).distanceTo(stage.eye.camera.position);
      if (depth > nearest + 0.05 || (Math.abs(depth - nearest) <= 0.05 && away >= best)) continue;
      nearest = depth;
      best = away;
      found = { curve, point };
    }
  }
  return found;
}

/**
 * The node that an end at a place of the window would snap to: the frontmost one near it.
 * @param {Stage} stage
 * @param {Point[]} nodes
 * @param {number} x
 * @param {number} y
 * @param {number} radius in the mesh's own unit
 * @returns {[number, number] | null} where it is in the window
 */
export function nodeAt(stage, nodes, x, y, radius) {
  const { camera } = stage.eye;
  let nearest = Infinity;
  let found = null;
  for (const node of nodes) {
    const place = toWindow(stage, node);
    const depth = stage.toScene(node).distanceTo(camera.position);
    const pixels = (radius * stage.frame.scale * stage.canvas.clientHeight * camera.projectionMatrix.elements[5]) / (2 * depth);
    if (Math.hypot(place[0] - x, place[1] - y) > Math.max(pixels, 4) || depth >= nearest) continue;
    nearest = depth;
    found = place;
  }
  return found;
}

/** @param {Stage} stage @param {Point[]} points */
export const toScene = (stage, points) => points.map((point) => stage.toScene(point));

