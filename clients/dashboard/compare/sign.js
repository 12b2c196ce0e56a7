// The sign of distances: on which side of B the places of A lie. The daemon proves it where B bounds a solid; where it does not,
// the page has the daemon's reason, and the side of the nearest face's normal is to be had, which nothing proves.

import { ProblemError } from "../js/index.js";
import { h } from "../core/dom.js";
import { parameter, setParameters } from "../core/route.js";
import { toggle } from "../view/tools.js";

/** @typedef {"none" | "outside" | "normal"} Sign */

const OF_LINK = /** @type {Record<string, Sign>} */ ({ 1: "outside", normal: "normal" });

export class SignChoice {
  /** @param {() => void} onChange */
  constructor(onChange) {
    /** @type {Sign} */
    this.sign = OF_LINK[parameter("signed") ?? ""] ?? "none";
    /** Why there is no proof, in the daemon's words. @type {string | null} */
    this.refusal = null;
    const choose = (/** @type {Sign} */ sign) => {
      this.set(sign);
      onChange();
    };
    this.button = toggle("Signed", "Tell what lies outside B from what lies inside", false, (isOn) => choose(isOn ? "outside" : "none"));
    this.normals = toggle("By the normals", "Take the side of the nearest face's normal, which nothing proves", false, (isOn) => choose(isOn ? "normal" : "none"));
    this.reason = h("p", { className: "muted small", id: "no-sign", role: "status" });
  }

  /** @param {Sign} sign */
  set(sign) {
    this.sign = sign;
    setParameters({ signed: { none: null, outside: 1, normal: "normal" }[sign] });
  }

  /**
   * Asks with the sign that is wanted; without one where the daemon does not prove it, for its reason.
   * @template T
   * @param {() => Promise<T>} question
   */
  async ask(question) {
    try {
      return await question();
    } catch (error) {
      if (!(error instanceof ProblemError) || error.code !== "not_closed") throw error;
      this.refusal = error.detail;
      this.set("none");
      return question();
    }
  }

  /** B is another one. */
  forget() {
    this.refusal = null;
  }

  /** @param {boolean} hasSides has B faces? */
  draw(hasSides) {
    this.button.disabled = !hasSides || this.refusal !== null;
    this.button.setAttribute("aria-pressed", String(this.sign === "outside"));
    this.normals.hidden = !hasSides || (this.refusal === null && this.sign !== "normal");
    this.normals.setAttribute("aria-pressed", String(this.sign === "normal"));
    this.reason.textContent = this.refusal === null ? "" : `No side is proven: ${this.refusal}`;
    this.reason.hidden = this.refusal === null;
  }
}
