// The deviation of A from B over the whole surface, and of B from A: figures, percentiles, histogram.

import { drawAxis, prepare } from "../core/canvas.js";
import { client } from "../core/connection.js";
import { colour, h } from "../core/dom.js";
import { count, intervals, length } from "../core/format.js";
import { makeTable, writeRows } from "../core/table.js";
import { colourOf } from "../view/scale.js";
import { bandRows } from "./bands.js";

/** @import { Search } from "../core/search.js" */
/** @import { DeviationRequest, DeviationResult, Interval, SignedDeviation } from "../../js/types.js" */
/** @import { Scale } from "../view/scale.js" */
/** @typedef {{ id: string, result: DeviationResult, distances: Float64Array, isStopped: boolean }} Deviation */
/** @typedef {Omit<DeviationRequest, "type">} Question */

export const FIRST_ACCURACY = 0.02;
const FIRST_PIECES = 262144;

/**
 * @param {Search} search
 * @param {Question} question
 * @returns {Promise<Deviation>}
 */
export async function measureDeviation(search, question) {
  const found = await search.run({ type: "deviation", accuracy: FIRST_ACCURACY, engine: { pieces: FIRST_PIECES }, ...question });
  const result = /** @type {DeviationResult} */ (found.result);
  const distances = result.vertex_count > 0 ? await client.jobs.distances(found.id, { signal: search.reader.signal }) : new Float64Array(0);
  return { ...found, result, distances };
}

/**
 * The figures of A from B, and beside them those of B from A where they were asked for.
 * @param {Deviation} there
 * @param {Deviation | null} back
 * @param {{ a: string, b: string }} names
 */
export function drawDeviation(there, back, names) {
  const columns = back ? [there.result, back.result] : [there.result];
  const rows = writeRows([["Mean", columns.map(({ mean }) => mean)], ["RMS", columns.map(({ rms }) => rms)], ["Maximum", columns.map(({ max }) => max)],
    ...there.result.percentiles.map(({ percent }, place) => /** @type {[string, Interval[]]} */ ([`${percent} % lie within`, columns.map(({ percentiles }) => percentiles[place])]))]);
  const table = makeTable("Figures of the distance", ["A from B", ...(back ? ["B from A"] : [])], rows);
  const stopped = [there, back].some((one) => one?.isStopped) ? " It was stopped before its end; what is written holds." : "";
  return h("div", { className: "section", id: "deviation" },
    h("p", { className: "muted small" }, `Of ${names.a} from ${names.b}, over its ${there.result.over}${there.result.signed ? "" : ", without a sign"}, in ${count(there.result.pieces)} pieces; each figure is proven.${stopped}`),
    table, there.result.signed && drawSigned(there.result.signed, there.result.over));
}

/** Share of a size below which no digits are wanted. */
const COUNTED = 1e-6;

/** The figures of each side. @param {SignedDeviation} signed @param {DeviationResult["over"]} over */
function drawSigned(signed, over) {
  const { proven, mean, outside, inside } = signed;
  const [farthest, sizes] = [writeRows([["Farthest", [outside.max, inside.max]]]), writeRows([[over === "area" ? "Area" : "Count", [outside.size, inside.size]]], COUNTED)];
  return h("div", { className: "section", id: "signed" },
    makeTable("Figures of both sides", ["Outside B", "Inside B"], [...farthest, ...sizes]),
    signed.bands.length > 0 && makeTable("Bands", ["A from B"], bandRows([signed])),
    h("p", { className: "muted small" }, `Mean with the sign, positive outside: ${intervals([mean])[0]}. ${proven ? "The sides are proven."
      : "The sides are those of the normals of B's nearest faces: not proven."}`));
}

/** @returns {HTMLCanvasElement} */
export const makeHistogram = () => h("canvas", { className: "drawing low", role: "img", "aria-label": "Histogram of the distances; its figures are in the table" });

/**
 * Bars in the colours of the heat map, with a mark from the lower to the upper bound of each share.
 * @param {HTMLCanvasElement} canvas
 * @param {DeviationResult} result
 * @param {Scale} scale
 */
export function drawHistogram(canvas, { histogram: { bin_width: width, shares } }, scale) {
  const { context, width: right, height } = prepare(canvas);
  const bottom = drawAxis(context, [0, 0.5, 1].map((share) => length(share * width * shares.length, 3)), right, height);
  const top = Math.max(...shares.map(([, upper]) => upper), 1e-12);
  const step = right / Math.max(1, shares.length);
  const y = (/** @type {number} */ share) => bottom - (share / top) * (bottom - 8);
  shares.forEach(([lower, upper], place) => {
    const middle = lower / 2 + upper / 2;
    const [r, g, b] = colourOf({ ...scale, isSigned: false, low: Math.max(0, scale.low) }, (place + 0.5) * width).map((x) => Math.round(255 * x));
    context.fillStyle = `rgb(${r} ${g} ${b})`;
    context.fillRect(place * step + 0.5, y(middle), step - 1, bottom - y(middle));
    if (upper - lower < top / 100) return;
    context.fillStyle = colour("--muted");
    context.fillRect((place + 0.5) * step - 0.5, y(upper), 1, y(lower) - y(upper));
  });
}
