// The shape of the faces of a mesh by the metrics of finite elements: a table of all, and how one of them spreads.

import { drawAxis, prepare } from "../core/canvas.js";
import { client } from "../core/connection.js";
import { colour, h } from "../core/dom.js";
import { count, length } from "../core/format.js";
import { run } from "../core/messages.js";
import { makeTable } from "../core/table.js";

/** @import { Mesh, QualitySummary } from "../../js/types.js" */

const BINS = 40;
const DIGITS = 4;

/** @param {HTMLElement} place @param {Mesh} mesh */
export async function showQuality(place, mesh) {
  const { metrics } = await client.meshes.quality(mesh.id);
  const known = metrics.filter(({ faces }) => faces > 0);
  const canvas = h("canvas", { className: "drawing low", role: "img", hidden: known.length === 0 });
  const show = async (/** @type {string} */ metric) => {
    for (const choice of place.querySelectorAll("button")) choice.setAttribute("aria-pressed", String(choice.textContent === wordsOf(metric)));
    await drawMetric(canvas, mesh, metric);
  };
  place.replaceChildren(tableOf(known, (metric) => run(() => show(metric))), canvas);
  if (known.length > 0) await show(known[0].metric);
}

/** How one metric spreads over the faces. @param {HTMLCanvasElement} canvas @param {Mesh} mesh @param {string} metric */
async function drawMetric(canvas, mesh, metric) {
  const { values, minimum, maximum } = await client.meshes.qualityOfFaces(mesh.id, metric);
  canvas.setAttribute("aria-label", `How many faces have which ${wordsOf(metric)}, from ${length(minimum, DIGITS)} to ${length(maximum, DIGITS)}`);
  drawBins(canvas, spread(values, minimum ?? 0, maximum ?? 0), minimum ?? 0, maximum ?? 0);
}

/** @param {string} metric */
const wordsOf = (metric) => metric.replaceAll("_", " ");

/** @param {QualitySummary[]} metrics @param {(metric: string) => void} onChosen */
function tableOf(metrics, onChosen) {
  return makeTable("Metrics of the faces", ["Least", "Mean", "Greatest"], metrics.map(({ metric, minimum, mean, maximum }) => [
    h("button", { type: "button", className: "quiet", "aria-pressed": false, onclick: () => onChosen(metric) }, wordsOf(metric)),
    [minimum, mean, maximum].map((value) => length(value, DIGITS))]));
}

/** How many values lie in each of equal parts of their range. @param {(number | null)[]} values @param {number} low @param {number} high */
function spread(values, low, high) {
  const bins = new Array(BINS).fill(0);
  for (const value of values) {
    if (value !== null) bins[high > low ? Math.min(BINS - 1, Math.floor((BINS * (value - low)) / (high - low))) : 0]++;
  }
  return bins;
}

/** @param {HTMLCanvasElement} canvas @param {number[]} bins @param {number} low @param {number} high */
function drawBins(canvas, bins, low, high) {
  const { context, width, height } = prepare(canvas);
  const [most, step] = [Math.max(...bins, 1), width / bins.length];
  const bottom = drawAxis(context, [length(low, DIGITS), `most: ${count(most)} faces`, length(high, DIGITS)], width, height);
  context.fillStyle = colour("--accent");
  bins.forEach((number, place) => {
    const size = (number / most) * (bottom - 16);
    context.fillRect(place * step + 0.5, bottom - size, step - 1, size);
  });
}
