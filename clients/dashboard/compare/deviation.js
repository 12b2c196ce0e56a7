// The deviation of A from B over the whole surface: heat map, colour bar, histogram, percentiles.

import { client } from "../core/connection.js";
import { colour, figures, h } from "../core/dom.js";
import { count, length } from "../core/format.js";
import { scaleColour } from "../view/colours.js";
import { prepare } from "./canvas.js";

/** @import { DeviationRequest, DeviationResult, LengthInterval } from "../../js/types.js" */
/** @typedef {{ id: string, result: DeviationResult, distances: Float64Array }} Deviation */

/**
 * @param {{ a: string, b: string, quads: any }} request
 * @param {AbortSignal} signal
 * @returns {Promise<Deviation>}
 */
export async function measureDeviation(request, signal) {
  /** @type {DeviationRequest} */
  const full = { type: "deviation", ...request, accuracy: 0.02, pieces: 262144 };
  const job = await client.jobs.create(full, { signal });
  for await (const event of client.jobs.events(job.id, { signal })) {
    if (event.event === "error") throw new Error(event.problem.detail);
    if (event.event === "result") {
      return { id: job.id, result: /** @type {DeviationResult} */ (event.result), distances: await client.jobs.distances(job.id, { signal }) };
    }
  }
  throw new Error("the job ended without a result");
}

/** An interval as one number where its digits agree. @param {LengthInterval} interval */
function interval({ lower, upper }) {
  const mean = lower / 2 + upper / 2;
  const half = upper / 2 - lower / 2;
  return `${length(mean, 5)} ± ${half === 0 ? "0" : half.toExponential(1)}`;
}

/** @param {Deviation} deviation @param {{ a: string, b: string }} names */
export function drawDeviation({ result }, names) {
  const over = { area: "its area", vertices: "its vertices", points: "its points" }[result.over];
  const canvas = h("canvas", { className: "drawing low", role: "img", "aria-label": "Histogram of the distances; its figures are in the table below" });
  const percentiles = h("table", {},
    h("caption", { className: "unseen" }, "Percentiles of the distance"),
    h("thead", {}, h("tr", {}, h("th", { scope: "col", className: "number" }, "Share of A"), h("th", { scope: "col", className: "number" }, "lies within"))),
    h("tbody", {}, ...result.percentiles.map((entry) => h("tr", {},
      h("td", { className: "number" }, `${entry.percent} %`), h("td", { className: "number" }, interval(entry))))));
  const element = h("div", { className: "section", id: "deviation" },
    h("p", { className: "muted small" }, `Of ${names.a} from ${names.b}, over ${over}; each figure is proven.`),
    figures([["Mean", interval(result.mean)], ["RMS", interval(result.rms)], ["Maximum", interval(result.max)],
      ["Pieces", count(result.pieces)]], "figures single"),
    canvas, percentiles);
  return { element, redraw: () => drawHistogram(canvas, result) };
}

/**
 * Bars in the colours of the heat map, with a mark from the lower to the upper bound of each share.
 * @param {HTMLCanvasElement} canvas
 * @param {DeviationResult} result
 */
function drawHistogram(canvas, { histogram: { bin_width: width, shares } }) {
  const { context, width: right, height } = prepare(canvas);
  const bottom = height - 20;
  const top = Math.max(...shares.map(([, upper]) => upper), 1e-12);
  const step = right / Math.max(1, shares.length);
  const y = (/** @type {number} */ share) => bottom - (share / top) * (bottom - 8);
  shares.forEach(([lower, upper], place) => {
    const middle = lower / 2 + upper / 2;
    const [r, g, b] = scaleColour((place + 0.5) / shares.length).map((x) => Math.round(255 * x));
    context.fillStyle = `rgb(${r} ${g} ${b})`;
    context.fillRect(place * step + 0.5, y(middle), step - 1, bottom - y(middle));
    if (upper - lower < top / 100) return;
    context.fillStyle = colour("--muted");
    context.fillRect((place + 0.5) * step - 0.5, y(upper), 1, y(lower) - y(upper));
  });
  context.fillStyle = colour("--line");
  context.fillRect(0, bottom, right, 1);
  context.fillStyle = colour("--muted");
  context.font = "11px system-ui, sans-serif";
  for (const [share, align] of /** @type {[number, CanvasTextAlign][]} */ ([[0, "left"], [0.5, "center"], [1, "right"]])) {
    context.textAlign = align;
    context.fillText(length(share * width * shares.length, 3), share * right, height - 5);
  }
}
