// What the colours stand for, as the user wants it: from where to where, or bands within limits. It stays until it is changed.

import { h } from "../core/dom.js";
import { say } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { toggle } from "../view/tools.js";

/** @import { Scale } from "../view/scale.js" */
/** @import { Deviation } from "./deviation.js" */
/** @typedef {{ range: [number, number] | null, limits: [number, number] | null }} Wanted null: all that there is; no bands */

/** Shares of A that buttons narrow the range to. */
const SHARES = [95, 99];

/** @type {Wanted} as it was left */
export const wanted = { range: null, limits: null };

/** Takes up what the address says. */
export function readWanted() {
  wanted.range = pairOf(parameter("range")) ?? wanted.range;
  wanted.limits = pairOf(parameter("limits")) ?? wanted.limits;
  writeWanted();
}

const writeWanted = () => setParameters({ range: wanted.range?.join(), limits: wanted.limits?.join() });

/** @param {string | null} text @returns {[number, number] | null} */
function pairOf(text) {
  const numbers = (text ?? "").split(",").map(Number);
  return text && numbers.length === 2 && numbers.every(Number.isFinite) && numbers[0] < numbers[1] ? [numbers[0], numbers[1]] : null;
}

/** @param {string} name @param {string} label */
const field = (name, label) => h("input", { name, inputMode: "decimal", "aria-label": label, autocomplete: "off" });

/** What someone is typing is not written over. @param {HTMLInputElement} input @param {number} value */
function write(input, value) {
  if (input !== document.activeElement) input.value = String(value);
}

/** @param {{ onChange: () => void, firstLimit: () => number | null }} options firstLimit: for bands that were never set */
export function makeRange({ onChange, firstLimit }) {
  const low = field("low", "First value of the colours");
  const high = field("high", "Last value of the colours");
  const inside = field("limit-in", "Limit inside B");
  const outside = field("limit-out", "Limit");
  const buttons = h("span", { className: "row" });
  const bands = toggle("Bands", "Colour what is within the limits, and what is beyond", false, (isOn) => {
    const limit = firstLimit() ?? Number(high.value);
    set({ limits: isOn ? wanted.limits ?? [-limit, limit] : null });
  });
  const limits = h("span", { className: "row limits" }, inside, outside);
  const element = h("div", { className: "section range", role: "group", "aria-label": "Colours" },
    h("div", { className: "row" }, "Colours from", low, "to", high, buttons), h("div", { className: "row" }, bands, limits));

  /** @param {Partial<Wanted>} change */
  function set(change) {
    Object.assign(wanted, change);
    writeWanted();
    onChange();
  }
  /** Two fields as a pair, or a word of what is wrong. @param {HTMLInputElement} one @param {HTMLInputElement} other @returns {[number, number] | null} */
  function read(one, other) {
    const pair = pairOf(`${one.value.trim() || 0},${other.value}`);
    if (!pair) say("The first number has to be below the second one.", { isFault: true });
    return pair;
  }
  for (const input of [low, high]) input.addEventListener("change", () => { const range = read(low, high); if (range) set({ range }); });
  for (const input of [inside, outside]) {
    input.addEventListener("change", () => {
      if (inside.hidden) inside.value = String(-Math.abs(Number(outside.value)));
      const pair = read(inside, outside);
      if (pair) set({ limits: pair });
    });
  }

  /** Of which distances there are buttons. @type {Deviation | null} */
  let offered = null;
  /** @param {Deviation} deviation */
  function offer(deviation) {
    if (offered === deviation) return; // who pressed one of them may press another
    offered = deviation;
    const { percentiles } = deviation.result;
    const choices = percentiles.filter(({ percent }) => SHARES.includes(percent)).map(({ percent, upper }) =>
      h("button", { type: "button", title: `To what ${percent} % of A lie within`, onclick: () => set({ range: [0, upper] }) }, `${percent} %`));
    buttons.replaceChildren(...choices, h("button", { type: "button", title: "To the largest distance", onclick: () => set({ range: null }) }, "All"));
  }

  /** @param {Scale} scale @param {Deviation} deviation */
  function draw(scale, deviation) {
    offer(deviation);
    write(low, Number(scale.low.toPrecision(4)));
    write(high, Number(scale.high.toPrecision(4)));
    bands.setAttribute("aria-pressed", String(wanted.limits !== null));
    limits.hidden = wanted.limits === null;
    inside.hidden = !deviation.result.signed; // colours come later than the sides
    for (const input of [low, high]) input.disabled = wanted.limits !== null;
    if (wanted.limits) [inside, outside].forEach((input, place) => write(input, /** @type {[number, number]} */ (wanted.limits)[place]));
  }
  return { element, draw };
}
