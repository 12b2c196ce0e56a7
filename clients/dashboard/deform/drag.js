// Dragging a handle on the surface: where it was taken, and how far the pointer has gone in the plane of the screen.

import { Plane, Raycaster, Vector2, Vector3 } from "three";

import { pick } from "../view/pick.js";

/** @import { Model } from "../view/model.js" */
/** @import { Stage } from "../view/stage.js" */
/** @typedef {{ point: number[], normal: number[] }} Hold */

/**
 * @param {Stage} stage
 * @param {{ model: () => Model | undefined, onTake: (hold: Hold) => void, onMove: (offset: number[]) => void,
 *   onRelease: () => void }} options offset: in the mesh's own space
 * @returns {() => void} what makes the view a plain one again
 */
export function listenToDrags(stage, { model, onTake, onMove, onRelease }) {
  const { canvas, eye } = stage;
  /** @type {{ plane: Plane, start: Vector3 } | null} */
  let held = null;

  /** @param {PointerEvent} event */
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return /** @type {[number, number]} */ ([event.clientX - box.left, event.clientY - box.top]);
  };
  /** @param {PointerEvent} event @param {Plane} plane */
  const onPlane = (event, plane) => {
    const [x, y] = at(event);
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight), eye.camera);
    return caster.ray.intersectPlane(plane, new Vector3());
  };
  /** @param {PointerEvent} event */
  const down = (event) => {
    const shown = model();
    if (event.button !== 0 || !shown?.isWhole) return;
    const hold = pick(stage, shown, ...at(event));
    if (!hold) return;
    const start = stage.toScene(hold.point);
    const plane = new Plane().setFromNormalAndCoplanarPoint(eye.camera.getWorldDirection(new Vector3()), start);
    held = { plane, start };
    eye.controls.enabled = false;
    canvas.setPointerCapture(event.pointerId);
    onTake(hold);
  };
  /** @param {PointerEvent} event */
  const move = (event) => {
    const place = held && onPlane(event, held.plane);
    if (held && place) onMove(place.sub(held.start).divideScalar(stage.frame.scale).toArray());
  };
  const up = () => {
    if (!held) return;
    held = null;
    eye.controls.enabled = true;
    onRelease();
  };
  const listeners = /** @type {[string, any][]} */ ([["pointerdown", down], ["pointermove", move], ["pointerup", up], ["pointercancel", up]]);
  for (const [name, listener] of listeners) canvas.addEventListener(name, listener, { capture: true });
  return () => {
    up();
    for (const [name, listener] of listeners) canvas.removeEventListener(name, listener, { capture: true });
  };
}
