// Pairs of places that belong together, clicked on A and on B in turn: each of the two is shown alone while it is its turn.

import { colour, h } from "../core/dom.js";
import { run } from "../core/messages.js";
import { listenToClicks } from "../view/clicks.js";
import { Labels } from "../view/labels.js";
import { pick, prepare } from "../view/pick.js";

/** @import { Point } from "../../js/types.js" */
/** @import { Role, Stage } from "../view/stage.js" */

export class Landmarks {
  /**
   * @param {Stage} stage
   * @param {(turn: Role) => void} onTurn called first, and after each place
   */
  constructor(stage, onTurn) {
    this.stage = stage;
    this.onTurn = onTurn;
    /** Places of A and B in turn. @type {Point[]} */
    this.places = [];
    this.labels = new Labels(stage);
    this.stop = listenToClicks(stage.canvas, (x, y) => run(() => this.take(x, y)));
    this.next();
  }

  /** Whose turn it is. @returns {Role} */
  get turn() {
    return this.places.length % 2 === 0 ? "a" : "b";
  }

  /** @returns {[Point, Point][]} */
  get pairs() {
    return Array.from({ length: Math.floor(this.places.length / 2) }, (_, n) => [this.places[2 * n], this.places[2 * n + 1]]);
  }

  /** @param {number} x @param {number} y */
  async take(x, y) {
    const model = this.stage.models.get(this.turn);
    if (!model?.isWhole) return;
    if (model.mesh.kind === "points") throw new Error("Places of point sets cannot be clicked.");
    await prepare(model);
    const found = pick(this.stage, model, x, y);
    if (!found) return;
    this.places.push(/** @type {Point} */ (found.point));
    this.next();
  }

  /** Without a pointer. */
  async takeMiddle() {
    const before = this.places.length;
    await this.take(this.stage.canvas.clientWidth / 2, this.stage.canvas.clientHeight / 2);
    if (this.places.length === before) throw new Error("There is no surface in the middle of the view.");
  }

  takeBack() {
    this.places.pop();
    this.next();
  }

  /** Shows the marks of whose turn it is. */
  next() {
    const { turn, labels } = this;
    for (const { element } of [...labels.all]) labels.remove(element);
    this.onTurn(turn);
    this.places.forEach((point, place) => {
      if ((place % 2 === 0 ? "a" : "b") !== turn) return;
      const mark = h("span", {}, String(Math.floor(place / 2) + 1));
      mark.style.borderColor = colour(`--mesh-${turn}`);
      labels.add(point, mark);
    });
  }

  dispose() {
    this.stop();
    this.labels.dispose();
  }
}
