// The heat map of a comparison: distances of A's vertices from B, also with the side of B on which they lie.

import { byId } from "../core/dom.js";
import { findSides, paint } from "../view/loader.js";
import { currentStage, setLook } from "../view/view.js";
import { measureDeviation } from "./deviation.js";
import { makeLegend } from "./legend.js";

/** @import { Model } from "../view/model.js" */
/** @import { Deviation } from "./deviation.js" */

export class Heat {
  constructor() {
    /** @type {Deviation | null} */
    this.deviation = null;
    /** 1 outside B, -1 inside, a vertex each. @type {Int8Array | null} */
    this.sides = null;
    this.isSigned = false;
    this.reader = new AbortController();
    /** What A's colours are of. @type {{ model: Model, deviation: Deviation, isSigned: boolean } | null} */
    this.painted = null;
  }

  /** The colours' ends; null without a map. */
  get scale() {
    const top = this.deviation?.result.max.upper ?? 0;
    return this.deviation ? { top: top > 0 ? top : 1, isSigned: this.isSigned && this.sides !== null } : null;
  }

  /** @param {{ a: string, b: string, quads: any }} request */
  async measure(request) {
    this.reader.abort();
    this.reader = new AbortController();
    this.deviation = await measureDeviation(request, this.reader.signal);
    this.sides = null;
    return this.deviation;
  }

  /** Can there be sides at all: has B faces? */
  get hasSides() {
    const b = currentStage()?.models.get("b");
    return this.deviation !== null && b !== undefined && b.mesh.kind !== "points";
  }

  /** Colours A, once it and the distances are there. */
  async paint() {
    const { deviation } = this;
    const [a, b] = [currentStage()?.models.get("a"), currentStage()?.models.get("b")];
    if (!deviation || !a?.isWhole || a.mesh.vertices !== deviation.distances.length) return;
    if (this.isSigned && this.hasSides && b?.isWhole) this.sides ??= await findSides(a, b, deviation.result.quads);
    if (deviation !== this.deviation) return;
    const { scale, sides } = this;
    const before = this.painted;
    if (!scale || (before?.model === a && before.deviation === deviation && before.isSigned === scale.isSigned)) return;
    await paint(a, scale.isSigned && sides ? deviation.distances.map((distance, vertex) => distance * sides[vertex]) : deviation.distances);
    if (deviation !== this.deviation) return;
    this.painted = { model: a, deviation, isSigned: scale.isSigned };
    setLook({ heat: true, signed: scale.isSigned, top: scale.top });
    byId("stage-legend").replaceChildren(makeLegend(scale, scale.isSigned ? "A's vertices: inside B, or outside" : "Distance of A's vertices from B"));
  }

  forget() {
    this.reader.abort();
    this.deviation = this.sides = this.painted = null;
    byId("stage-legend").replaceChildren();
    setLook({ heat: false });
  }
}
