// The figures of a measurement: both bounds, gap, iterations, pieces, time, verdict.

import { h } from "../core/dom.js";
import { count, duration, length, percent, small } from "../core/format.js";
import { drawChart } from "./chart.js";

/** @import { Measurement } from "./measurement.js" */

export function makeOutcome() {
  const value = () => h("span", { className: "value" }, "–");
  const relative = () => h("div", { className: "relative" }, " ");
  const parts = {
    lower: value(), upper: value(), lowerShare: relative(), upperShare: relative(), gap: value(), iterations: value(),
    projections: value(), queue: value(), time: value(), rate: value(),
  };
  const bound = (/** @type {string} */ name, /** @type {Node} */ shown, /** @type {Node} */ share) => h("div", {},
    h("dt", {}, h("span", { className: `swatch ${name}` }), `${name} bound`), h("dd", { id: name }, shown, share));
  const row = (/** @type {string} */ id, /** @type {string} */ words, /** @type {Node} */ shown) =>
    h("div", {}, h("dt", {}, words), h("dd", { id }, shown));
  const chart = h("canvas", { className: "drawing", role: "img", "aria-label": "Both bounds over time" });
  const words = h("p", { className: "outcome muted", id: "outcome", role: "status" });
  const verdict = h("p", { className: "verdict", id: "verdict", hidden: true });
  const element = h("div", { className: "section" },
    h("dl", { className: "bounds" }, bound("lower", parts.lower, parts.lowerShare), bound("upper", parts.upper, parts.upperShare)),
    words, verdict, chart,
    h("dl", { className: "figures" },
      row("gap", "Gap / diagonal", parts.gap), row("elapsed", "Search", parts.time),
      row("iterations", "Iterations", parts.iterations), row("pieces", "Pieces", parts.queue),
      row("projections", "Projections", parts.projections), row("rate", "Per second", parts.rate)));

  /** @param {Measurement} measurement @param {number | null} limit */
  function draw(measurement, limit) {
    const last = measurement.samples.at(-1);
    const { result } = measurement;
    parts.lower.textContent = length(last?.lower);
    parts.upper.textContent = length(last?.upper);
    parts.lowerShare.textContent = last ? `${percent(last.lower_relative)} of A's diagonal` : " ";
    parts.upperShare.textContent = last && last.upper_relative !== null ? `${percent(last.upper_relative)} of A's diagonal` : " ";
    const gap = last && last.upper_relative !== null && last.lower_relative !== null ? last.upper_relative - last.lower_relative : null;
    parts.gap.textContent = small(gap);
    parts.iterations.textContent = count(last?.iterations);
    parts.projections.textContent = count(last?.projections);
    parts.queue.textContent = result ? `≤ ${count(result.max_queue)}` : count(last && "queue" in last ? last.queue : null);
    parts.time.textContent = last ? duration(last.elapsed_ms) : "–";
    parts.rate.textContent = last && last.elapsed_ms > 0 ? count(Math.round((1000 * last.iterations) / last.elapsed_ms)) : "–";
    words.textContent = measurement.words;
    words.classList.toggle("fault", measurement.stage === "failed" || measurement.stage === "lost");
    verdict.hidden = !result?.verdict;
    verdict.className = `verdict ${result?.verdict ?? ""}`;
    verdict.textContent = result?.verdict ? `The distance is ${result.verdict} the limit ${limit ?? ""}.` : "";
    drawChart(chart, measurement.samples, limit);
    chart.setAttribute("aria-label", last ? `Both bounds over time; now ${length(last.lower)} and ${length(last.upper)}` : "Both bounds over time");
  }
  return { element, draw };
}
