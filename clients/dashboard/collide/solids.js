// A and B as solids: apart, touching, one inside of the other, or reaching into each other, and how deep and where.

import { ProblemError } from "../js/index.js";
import { h } from "../core/dom.js";
import { ENOUGH, intervals, length } from "../core/format.js";
import { sayFault } from "../core/messages.js";
import { Search } from "../core/search.js";
import { makeTable, writeRows } from "../core/table.js";
import { makePlaces } from "../view/places.js";
import { currentStage } from "../view/view.js";

/** @import { CollisionResult, Depth, MeshName, QuadReading } from "../../js/types.js" */

const DIGITS = 4;

export class Solids {
  /** @param {{ quads: () => QuadReading }} options */
  constructor({ quads }) {
    this.quads = quads;
    this.searching = new Search(() => "");
    this.relation = h("p", { className: "outcome", id: "relation", role: "status" });
    this.found = h("div", { className: "section", id: "penetration" });
    this.element = h("section", { className: "section", "aria-labelledby": "solids-title", hidden: true },
      h("h2", { id: "solids-title" }, "As solids"), this.searching.element, this.relation, this.found);
  }

  /** @param {MeshName} a @param {string} b */
  async search(a, b) {
    this.forget();
    this.element.hidden = false;
    try {
      const { result: answer, isStopped } = await this.searching.run({ type: "collision", a, b, quads: this.quads(), mode: "any", penetration: true });
      this.draw(/** @type {CollisionResult} */ (answer), isStopped);
    } catch (error) {
      if (!(error instanceof ProblemError)) throw error;
      if (error.code !== "not_closed") sayFault(error);
      this.relation.textContent = `They are not taken as solids: ${error.detail}`;
    }
  }

  /** @param {CollisionResult} result @param {boolean} isStopped */
  draw({ relation, penetration }, isStopped) {
    this.relation.textContent = relation ? relationOf(relation, penetration) : isStopped ? "Stopped before it was known." : "";
    if (!penetration) return;
    const sides = /** @type {[string, Depth][]} */ ([["A in B", penetration.a_in_b], ["B in A", penetration.b_in_a]]);
    const rows = writeRows([["Greatest depth", sides.map(([, depth]) => depth)]]);
    const deepest = sides.filter(([, { witness }]) => witness);
    const written = intervals(deepest.map(([, depth]) => depth), ENOUGH);
    const places = deepest.map(([name, { witness }], place) => {
      const { from, to } = /** @type {NonNullable<typeof witness>} */ (witness);
      return { words: `${name}: ${written[place]}`, points: [from.point, to.point], what: `the deepest point of ${name}` };
    });
    this.found.replaceChildren(makeTable("Penetration", sides.map(([name]) => name), rows),
      places.length > 0 ? makePlaces("Deepest places", places, (place) => currentStage()?.setPair({ from: places[place].points[0], to: places[place].points[1] })) : "");
  }

  forget() {
    this.searching.leave();
    this.element.hidden = true;
    this.relation.textContent = "";
    this.found.replaceChildren();
    currentStage()?.setPair(null);
  }
}

/** @param {NonNullable<CollisionResult["relation"]>} relation @param {CollisionResult["penetration"]} penetration */
function relationOf(relation, penetration) {
  if (relation === "meeting") return meetingOf(penetration);
  return { apart: "The solids are apart.", a_inside_b: "A is inside of B.", b_inside_a: "B is inside of A.",
    overlapping: "The surfaces do not meet, but some parts of one solid are inside of the other." }[relation];
}

/** What is known of solids whose surfaces meet. @param {CollisionResult["penetration"]} penetration */
function meetingOf(penetration) {
  if (!penetration) return "The surfaces meet.";
  const { a_in_b: there, b_in_a: back } = penetration;
  if (there.lower > 0 || back.lower > 0) return "The solids reach into each other.";
  const most = Math.max(there.upper, back.upper);
  return most === 0 ? "The solids touch: neither reaches into the other."
    : `The solids touch, or reach into each other by no more than ${length(most, DIGITS)}: more is not known.`;
}
