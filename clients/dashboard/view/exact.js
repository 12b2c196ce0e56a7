// Signs of determinants of doubles, which are exact: a quick sum where its rounding cannot change the sign, else whole numbers of any size.

/** The unit of rounding, and the bounds of Shewchuk (1997) of the quick sums' errors, as shares of the sums of magnitudes. */
const UNIT = 2 ** -53;
const PLANE_BOUND = (3 + 16 * UNIT) * UNIT;
const SPACE_BOUND = (7 + 56 * UNIT) * UNIT;
/** Below this products may have lost digits to the end of the range. */
const LEAST = 1e-280;

const bits = new DataView(new ArrayBuffer(8));

/** A double as a whole number times a power of two. @param {number} x @returns {[bigint, number]} */
function split(x) {
  bits.setFloat64(0, x);
  const high = bits.getUint32(0);
  const power = (high >>> 20) & 0x7ff;
  const fraction = (BigInt(high & 0xfffff) << 32n) | BigInt(bits.getUint32(4));
  const whole = power === 0 ? fraction : fraction | (1n << 52n);
  return [high >>> 31 ? -whole : whole, Math.max(power, 1) - 1075];
}

/** Doubles as whole numbers of one unit. @param {number[]} values */
function toWhole(values) {
  const parts = values.map(split);
  const least = Math.min(...parts.map(([, power]) => power));
  return parts.map(([whole, power]) => whole << BigInt(power - least));
}

/** @param {bigint} x */
const signOf = (x) => (x > 0n ? 1 : x < 0n ? -1 : 0);

/**
 * On which side of the line from a to b a point p of the plane lies: 1 left, -1 right, 0 on it.
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by @param {number} px @param {number} py
 */
export function sideOfLine(ax, ay, bx, by, px, py) {
  const [one, other] = [(ax - px) * (by - py), (ay - py) * (bx - px)];
  const sum = one - other;
  const size = Math.abs(one) + Math.abs(other);
  if (Math.abs(sum) > PLANE_BOUND * size && size > LEAST && size < Infinity) return Math.sign(sum);
  const [ax_, ay_, bx_, by_, px_, py_] = toWhole([ax, ay, bx, by, px, py]);
  return signOf((ax_ - px_) * (by_ - py_) - (ay_ - py_) * (bx_ - px_));
}

/**
 * On which side of the plane through a, b and c a point p lies: 1 where the normal (b - a) x (c - a) points to, -1 on the other one, 0 on it.
 * @param {ArrayLike<number>} a @param {ArrayLike<number>} b @param {ArrayLike<number>} c @param {ArrayLike<number>} p
 */
export function sideOfPlane(a, b, c, p) {
  const rows = [a, b, c].map((corner) => [corner[0] - p[0], corner[1] - p[1], corner[2] - p[2]]);
  const terms = [0, 1, 2].flatMap((k) => {
    const [u, v, w] = [rows[k], rows[(k + 1) % 3], rows[(k + 2) % 3]];
    return [u[2] * v[0] * w[1], -u[2] * v[1] * w[0]];
  });
  const sum = terms.reduce((all, term) => all + term, 0);
  const size = terms.reduce((all, term) => all + Math.abs(term), 0);
  // Products of three and sums of six terms are rounded a little more often than in his order of them.
  if (Math.abs(sum) > 2 * SPACE_BOUND * size && size > LEAST && size < Infinity) return -Math.sign(sum);
  const whole = toWhole([a, b, c, p].flatMap((corner) => [corner[0], corner[1], corner[2]]));
  const [u, v, w] = [0, 3, 6].map((from) => [0, 1, 2].map((k) => whole[from + k] - whole[9 + k]));
  return 0 - signOf(u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0]) + u[2] * (v[0] * w[1] - v[1] * w[0]));
}
