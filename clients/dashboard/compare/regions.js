// The connected parts of A that are beyond the limit: a list that flies to each, and the borders of their faces in the view.

import { colour, h } from "../core/dom.js";
import { ENOUGH, count, intervals } from "../core/format.js";
import { run } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { outline } from "../view/loader.js";
import { makePlaces } from "../view/places.js";
import { currentStage } from "../view/view.js";

/** @import { DeviationRegion, DeviationResult } from "../../js/types.js" */

/** More than these are not listed, for the farthest come first. */
const MOST_LISTED = 50;

export class Regions {
  constructor() {
    this.element = h("div", { className: "section", id: "regions" });
    /** @type {DeviationRegion[]} */
    this.listed = [];
    /** @type {DeviationRegion | null} */
    this.chosen = null;
  }

  /** @param {DeviationResult} result @param {number | null} limit that was asked for */
  draw({ regions, region_count: all = 0, verdict }, limit) {
    this.listed = (regions ?? []).slice(0, MOST_LISTED);
    const chosen = Number(parameter("region") ?? 0) - 1;
    this.chosen = this.listed[chosen] ?? null;
    this.element.replaceChildren();
    if (limit === null || regions === undefined) return;
    const words = all === 0 ? `No part of A is beyond ${limit}.` : `${count(all)} part${all === 1 ? "" : "s"} of A ${verdict === "above" ? "" : "may be "}beyond ${limit}`
      + `${all > MOST_LISTED ? `; the farthest ${MOST_LISTED}` : ""}:`;
    this.element.append(h("p", {}, words));
    if (all > 0) this.element.append(makePlaces("Parts beyond the limit", this.places(), (place) => run(() => this.choose(place)), chosen));
  }

  places() {
    const farthest = intervals(this.listed.map(({ max }) => max), ENOUGH);
    const areas = intervals(this.listed.map(({ area }) => area), ENOUGH);
    return this.listed.map(({ surely, witness, centroid, box }, place) => ({
      words: `${place + 1}: up to ${farthest[place]}, area ${areas[place]}${surely ? "" : ", not certain"}`,
      points: witness ? [witness.from.point, witness.to.point] : [centroid, box.min, box.max], what: `part ${place + 1}` }));
  }

  /** @param {number} place */
  async choose(place) {
    this.chosen = this.listed[place];
    setParameters({ region: place + 1 });
    await this.paint();
  }

  /** Draws the edges round the faces: of all parts thinly, of the one that is looked at strongly. What is inside keeps its colours. */
  async paint() {
    const { listed, chosen } = this;
    const stage = currentStage();
    const a = stage?.models.get("a");
    if (!stage || !a?.isWhole) return;
    const [thin, strong] = await Promise.all([listed.filter((region) => region !== chosen), chosen ? [chosen] : []].map((regions) =>
      outline(a, regions.flatMap(({ faces }) => faces), stage.frame)));
    const [{ toVector }, { bordersOf }] = await Promise.all([import("../view/stage.js"), import("../view/borders.js")]);
    if (listed !== this.listed || chosen !== this.chosen) return;
    const ribbons = (/** @type {Float32Array} */ triangles, /** @type {string} */ name, /** @type {number} */ width) =>
      bordersOf(triangles).map((points) => ({ points, colour: toVector(colour(name)), width }));
    stage.setOverlay({ ribbons: [...ribbons(thin, "--ink", 1.2), ...ribbons(strong, "--fault", 3)] });
  }

  forget() {
    this.listed = [];
    this.chosen = null;
    this.element.replaceChildren();
    currentStage()?.setOverlay();
  }
}
