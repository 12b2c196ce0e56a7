// The record of the steps of a reconstruction: quads and the proven distance to the source after each.

import { colour, h } from "../core/dom.js";
import { count, duration, length, percent, percentOfPower } from "../core/format.js";
import { prepare } from "../core/canvas.js";

/** @import { StepRecord } from "../../js/types.js" */

/** How far the surface lies from the quads; of a point set, as far as it is covered. @param {Partial<StepRecord> | undefined} record */
export const distanceOf = (record) => record?.covered ?? record?.hausdorff ?? null;

/**
 * Both bounds of the distance after the last step, or of quads that came at once.
 * @param {HTMLElement} place
 * @param {Partial<StepRecord> | undefined} last
 * @param {string[]} [notes]
 */
export function drawBounds(place, last, notes = []) {
  const hausdorff = distanceOf(last);
  const bound = (/** @type {"lower" | "upper"} */ name) => h("div", {},
    h("dt", {}, h("span", { className: `swatch ${name}` }), `${name} bound`),
    h("dd", {}, length(hausdorff?.[name], 6), h("div", { className: "relative" }, `${percent(hausdorff?.[`${name}_relative`])} of the diagonal`)));
  const { uncovered_points: uncovered = 0, beyond_points: beyond = 0, mesh_to_points: back } = last ?? {};
  const others = uncovered + beyond;
  const more = [others ? `${count(others)} points that no patch covers are left out` : "",
    back ? `The quads lie ${percent(back.upper_relative)} from the points at most` : "", ...notes].filter((words) => words !== "");
  place.replaceChildren(h("dl", { className: "bounds" }, bound("lower"), bound("upper")),
    ...more.map((words) => h("p", { className: "muted small" }, `${words}.`)));
}

/** @param {StepRecord} record */
function intervalOf(record) {
  const distance = distanceOf(record);
  return distance ? `${percent(distance.lower_relative)} – ${percent(distance.upper_relative)}` : "not measured";
}

/** @param {StepRecord[]} steps */
export function stepTable(steps) {
  const heads = ["Step", "Quads", "Distance / diagonal", "Time"];
  return h("table", {},
    h("caption", { className: "unseen" }, "Steps of the reconstruction"),
    h("thead", {}, h("tr", {}, ...heads.map((words) => h("th", { scope: "col", className: "number" }, words)))),
    h("tbody", {}, ...steps.map((record, place) => h("tr", {},
      h("td", { className: "number" }, String(place + 1)), h("td", { className: "number" }, count(record.quads)),
      h("td", { className: "number" }, intervalOf(record)),
      h("td", { className: "number" }, duration(record.step_ms + record.measure_ms)))).reverse()));
}

/**
 * The distance over the number of quads, both on logarithmic scales; bars from the lower to the upper bound.
 * @param {HTMLCanvasElement} canvas
 * @param {StepRecord[]} steps
 */
export function drawSteps(canvas, steps) {
  const { context, width, height } = prepare(canvas);
  const known = steps.flatMap((record) => {
    const distance = distanceOf(record);
    return distance?.upper_relative ? [{ quads: record.quads, lower: distance.lower_relative ?? 0, upper: distance.upper_relative }] : [];
  });
  if (known.length === 0) return;
  const [left, right, top, bottom] = [58, 14, 10, 24];
  const low = Math.floor(Math.log10(Math.min(...known.map(({ upper }) => upper))));
  const high = Math.max(low + 1, Math.ceil(Math.log10(Math.max(...known.map(({ upper }) => upper)))));
  const [least, most] = [known[0].quads, Math.max(known[0].quads * 2, ...known.map(({ quads }) => quads))].map(Math.log10);
  const x = (/** @type {number} */ quads) => left + ((Math.log10(quads) - least) / (most - least)) * (width - left - right);
  const y = (/** @type {number} */ value) => height - bottom - Math.max(0, (Math.log10(Math.max(value, 1e-300)) - low) / (high - low)) * (height - top - bottom);
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (let power = low; power <= high; power++) {
    context.fillStyle = colour("--line");
    context.fillRect(left, y(10 ** power), width - left - right, 1);
    context.fillStyle = colour("--muted");
    context.fillText(percentOfPower(power), left - 8, y(10 ** power));
  }
  context.textBaseline = "alphabetic";
  context.textAlign = "left";
  context.fillText(`${count(known[0].quads)} quads`, left, height - 7);
  context.textAlign = "right";
  context.fillText(count(Math.round(10 ** most)), width - right, height - 7);
  context.strokeStyle = context.fillStyle = colour("--accent");
  context.lineWidth = 2;
  context.beginPath();
  for (const { quads, upper } of known) context.lineTo(x(quads), y(upper));
  context.stroke();
  for (const { quads, lower, upper } of known) {
    context.beginPath();
    context.arc(x(quads), y(upper), 3.5, 0, 2 * Math.PI);
    context.fill();
    context.fillRect(x(quads) - 0.5, y(upper), 1, y(lower) - y(upper));
  }
}
