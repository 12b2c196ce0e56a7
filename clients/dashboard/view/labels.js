// Words at places of the surfaces, over the view: they go with the eye, and are dashed where something lies before them.

import { h } from "../core/dom.js";
import { prepare } from "./pick.js";
import { isSeen } from "./sight.js";

/** @import { Stage } from "./stage.js" */
/** @typedef {{ point: number[], element: HTMLElement }} Label point: in the space of the meshes */

export class Labels {
  /** @param {Stage} stage */
  constructor(stage) {
    this.stage = stage;
    this.place = h("div", { className: "pins" });
    stage.place.append(this.place);
    /** @type {Label[]} */
    this.all = [];
    /** Can it be told what is hidden? */
    this.isReady = false;
    stage.eye.controls.addEventListener("change", this.draw);
    this.sizes = new ResizeObserver(this.draw);
    this.sizes.observe(stage.place);
    Promise.all(stage.opaqueModels().map(prepare)).then(() => {
      this.isReady = true;
      this.draw();
    });
  }

  /** @param {number[]} point @param {HTMLElement} element */
  add(point, element) {
    element.classList.add("pin");
    this.place.append(element);
    this.all.push({ point, element });
    this.draw();
  }

  /** @param {HTMLElement} element */
  remove(element) {
    this.all = this.all.filter((label) => label.element !== element);
    element.remove();
  }

  /** Where a point is in the window, and whether it is before the eye. @param {number[]} point */
  placeOf(point) {
    const { canvas, eye: { camera } } = this.stage;
    const place = this.stage.toScene(point);
    const isThere = place.clone().applyMatrix4(camera.matrixWorldInverse).z < 0;
    const on = place.project(camera);
    return { x: ((on.x + 1) / 2) * canvas.clientWidth, y: ((1 - on.y) / 2) * canvas.clientHeight, isThere };
  }

  draw = () => {
    const { stage } = this;
    stage.eye.camera.updateMatrixWorld(); // the eye has moved, and nothing was drawn since
    for (const { point, element } of this.all) {
      const { x, y, isThere } = this.placeOf(point);
      element.hidden = !isThere;
      const isHidden = this.isReady && !isSeen(stage.opaqueModels(), stage.eye.camera.position, stage.toScene(point));
      element.classList.toggle("is-hidden", isHidden);
      [element.style.left, element.style.top] = [`${x}px`, `${y}px`];
    }
  };

  dispose() {
    this.stage.eye.controls.removeEventListener("change", this.draw);
    this.sizes.disconnect();
    this.place.remove();
  }
}

/** The labels of a picture. @param {CanvasRenderingContext2D} context @param {Labels} labels */
export function drawLabels(context, labels) {
  const ratio = context.canvas.width / labels.stage.canvas.clientWidth;
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  context.textAlign = "left";
  const style = getComputedStyle(document.body);
  for (const { point, element } of labels.all) {
    const { x, y, isThere } = labels.placeOf(point);
    if (!isThere) continue;
    const words = element.textContent ?? "";
    const [left, top] = [x * ratio, y * ratio];
    context.fillStyle = style.backgroundColor;
    context.fillRect(left + 8 * ratio, top - 10 * ratio, context.measureText(words).width + 12 * ratio, 20 * ratio);
    context.fillStyle = style.color;
    context.beginPath();
    context.arc(left, top, 4 * ratio, 0, 2 * Math.PI);
    context.fill();
    context.fillText(words, left + 14 * ratio, top);
  }
}
