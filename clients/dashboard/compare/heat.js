// The colours of A: the distance of each of its places from B, with the side of B on which it lies where that was asked for, and how far they may be off.

import { byId } from "../core/dom.js";
import { heat } from "../view/loader.js";
import { currentStage, setLook } from "../view/view.js";
import { makeLegend } from "./legend.js";

/** @import { Telling } from "../view/against.js" */
/** @import { Model } from "../view/model.js" */
/** @import { Scale } from "../view/scale.js" */
/** @import { Deviation } from "./deviation.js" */
/** @import { Wanted } from "./range.js" */

/** The colours are refined until they are off by this share of their range at most, or the triangles run out. */
export const GOOD_SHARE = 0.01;

export class Heat {
  /** @param {Wanted} wanted the range and limits that were set by hand */
  constructor(wanted) {
    this.wanted = wanted;
    /** @type {Deviation | null} */
    this.deviation = null;
    /** 1 outside B, -1 inside, 0 neither for certain, a vertex each. @type {Int8Array | null} */
    this.sides = null;
    /** How far the colours may be off between A's vertices. */
    this.error = 0;
    /** What A's colours are of. @type {{ model: Model, other: Model, key: string } | null} */
    this.painted = null;
  }

  /** What the colours stand for; null without a map. @returns {Scale | null} */
  get scale() {
    if (!this.deviation) return null;
    const isSigned = this.telling !== "none" && this.sides !== null;
    const most = this.deviation.result.max.upper || 1;
    const { range, limits } = this.wanted;
    const [low, high] = range ?? [0, most];
    return { low: isSigned ? (low < 0 ? low : -high) : Math.max(0, low), high, isSigned,
      limits: limits && [isSigned ? limits[0] : -Infinity, limits[1]] };
  }

  /** Is there something beyond the last colour? */
  get isClamped() {
    return this.deviation !== null && this.scale !== null && this.deviation.result.max.upper > this.scale.high * (1 + 1e-12);
  }

  /** Can there be sides at all: has B faces? */
  get hasSides() {
    const b = currentStage()?.models.get("b");
    return this.deviation !== null && b !== undefined && b.mesh.kind !== "points";
  }

  /** How the page tells sides, as the deviation has them: where the daemon has proven that B bounds a solid, they are proven here, too. @returns {Telling} */
  get telling() {
    const signed = this.deviation?.result.signed;
    return !signed || !this.hasSides ? "none" : signed.proven ? "solid" : "normal";
  }

  /** Takes up what was measured. @param {Deviation} deviation */
  take(deviation) {
    this.deviation = deviation;
    this.sides = this.painted = null;
  }

  /** The error that is good enough for the range. */
  get target() {
    const scale = this.scale;
    return scale ? GOOD_SHARE * (scale.high - Math.max(0, scale.low)) : 0;
  }

  /** Colours A, once it and the distances are there. @param {{ a: string, b: string }} names */
  async paint(names) {
    const { deviation } = this;
    const [a, b] = [currentStage()?.models.get("a"), currentStage()?.models.get("b")];
    if (!deviation || !a?.isWhole || !b?.isWhole) return;
    const { telling } = this;
    const key = `${deviation.id} ${this.target}`;
    if (this.painted?.model !== a || this.painted.other !== b || this.painted.key !== key) {
      const { error, sides } = await heat(a, b, { quads: deviation.result.quads, telling, target: this.target });
      if (deviation !== this.deviation || currentStage()?.models.get("a") !== a) return;
      Object.assign(this, { error, sides: sides ?? this.sides, painted: { model: a, other: b, key } });
    }
    this.show(names);
  }

  /** Puts the scale into the view, and the legend beside it. @param {{ a: string, b: string }} names */
  show(names) {
    const { scale } = this;
    if (!scale || !this.painted) return;
    setLook({ heat: true, scale });
    byId("stage-legend").replaceChildren(makeLegend(scale, this.wordsOf(names)));
  }

  /** What the legend says. @param {{ a: string, b: string }} names */
  wordsOf({ a, b }) {
    const signed = this.deviation?.result.signed;
    const sides = !signed ? "" : signed.proven ? ", sides proven" : ", sides by the normals, not proven";
    return { title: `Distance of ${a} from ${b}${sides}`, error: this.error, isClamped: this.isClamped };
  }

  forget() {
    this.deviation = this.sides = this.painted = null;
    this.error = 0;
    byId("stage-legend").replaceChildren();
    setLook({ heat: false });
  }
}
