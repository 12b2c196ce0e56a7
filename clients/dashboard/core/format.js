// Numbers in words that line up.

const NONE = "–";

/** @param {number | null | undefined} value a count */
export const count = (value) => (value === null || value === undefined ? NONE : value.toLocaleString("en"));

/**
 * A length or bound with a fixed number of digits, so that what converges can be read off.
 * @param {number | null | undefined} value
 * @param {number} [digits] significant ones
 */
export function length(value, digits = 9) {
  if (value === null || value === undefined || Number.isNaN(value)) return NONE;
  if (value === 0) return "0";
  if (!Number.isFinite(value)) return "∞";
  const size = Math.abs(value);
  return size >= 1e-4 && size < 1e7 ? value.toPrecision(digits) : value.toExponential(digits - 1);
}

/**
 * Intervals as "middle ± half", with no digits beyond what is uncertain, all of them fixed or all with the same power of ten. What
 * is written holds the interval: halves are rounded up.
 * @param {{ lower: number, upper: number }[]} intervals
 * @param {number} [finest] share of the middle below which no digits are wanted
 */
export function intervals(intervals, finest = 0) {
  const most = Math.max(...intervals.map(({ lower, upper }) => Math.max(Math.abs(lower), Math.abs(upper))));
  const power = most > 0 && (most < 1e-3 || most >= 1e7) ? Math.floor(Math.log10(most)) : 0;
  return intervals.map((interval) => (power === 0 ? spread(interval, finest) : `${spread({
    lower: interval.lower / 10 ** power, upper: interval.upper / 10 ** power }, finest)} e${power}`));
}

/** Where there is room for few digits. */
export const ENOUGH = 0.01;
const MOST_DIGITS = 12;

/** @param {{ lower: number, upper: number }} interval of numbers of a handy size @param {number} finest */
function spread({ lower, upper }, finest) {
  if (lower === upper) return String(Number(lower.toPrecision(9)));
  const [middle, half] = [lower / 2 + upper / 2, upper / 2 - lower / 2];
  const digits = Math.max(0, Math.min(MOST_DIGITS, 1 - Math.floor(Math.log10(Math.max(half, finest * Math.abs(middle))))));
  const shown = Number(middle.toFixed(digits));
  // Rounded up, but for what the sums above may be off by.
  const reach = Math.ceil(Math.max(upper - shown, shown - lower) * 10 ** digits * (1 - 1e-12)) / 10 ** digits;
  return `${shown.toFixed(digits)} ± ${reach.toFixed(digits)}`;
}

/** @param {number | null | undefined} value small numbers, such as gaps */
export const small = (value) => (value === null || value === undefined ? NONE : value === 0 ? "0" : value.toExponential(2));

/** @param {number | null | undefined} share */
export const percent = (share) => (share === null || share === undefined ? NONE : `${(share * 100).toPrecision(3)} %`);

/** Digits of a share that is not known exactly. */
const SHARE_DIGITS = 3;
/** Behind the point of a share in percent. */
const MOST_SHARE_DIGITS = 4;

/**
 * A share that is only known to lie between two others; what is written holds them.
 * @param {{ lower: number, upper: number }} share
 */
export function shareBetween({ lower, upper }) {
  if (lower === upper) return percent(lower);
  const outward = (/** @type {number} */ share, /** @type {(x: number) => number} */ round) => {
    const value = 100 * share;
    if (value <= 0) return "0";
    const digits = Math.max(0, Math.min(MOST_SHARE_DIGITS, SHARE_DIGITS - 1 - Math.floor(Math.log10(value))));
    return (round(value * 10 ** digits) / 10 ** digits).toFixed(digits);
  };
  return `${outward(lower, Math.floor)} to ${outward(Math.min(1, upper), Math.ceil)} %`;
}

/** @param {number} power of ten */
export const percentOfPower = (power) => (power >= -5 ? `${Number(`1e${power + 2}`)} %` : `1e${power + 2} %`);

/** @param {number} ms */
export function duration(ms) {
  if (ms < 1000) return `${ms < 10 ? ms.toFixed(1) : Math.round(ms)} ms`;
  if (ms < 60000) return `${(ms / 1000).toFixed(1)} s`;
  const seconds = Math.round(ms / 1000);
  return seconds < 3600 ? `${Math.floor(seconds / 60)} min ${seconds % 60} s`
    : `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
}

/** @param {number} size */
export function bytes(size) {
  const units = ["B", "kB", "MB", "GB"];
  let place = 0;
  for (; size >= 1000 && place + 1 < units.length; place++) size /= 1000;
  return `${place === 0 ? size : size.toPrecision(3)} ${units[place]}`;
}

/** @param {string} iso */
export function time(iso) {
  const then = new Date(iso);
  const isToday = then.toDateString() === new Date().toDateString();
  const clock = then.toLocaleTimeString("en-GB");
  return isToday ? clock : `${then.toLocaleDateString("en-CA")} ${clock}`;
}

/** @param {{ triangles: number, quads: number, polygons: number }} faces */
export const faceCount = (faces) => faces.triangles + faces.quads + faces.polygons;

/** @param {import("../../js/types.js").Mesh} mesh */
export function summary(mesh) {
  if (mesh.kind === "points") return `${count(mesh.vertices)} points`;
  const { triangles, quads, polygons } = mesh.faces;
  const parts = /** @type {[string, number][]} */ ([["triangle", triangles], ["quad", quads], ["polygon", polygons]]);
  return parts.filter(([, number]) => number > 0).map(([name, number]) => `${count(number)} ${name}${number === 1 ? "" : "s"}`).join(", ");
}
