// The Coons patch of four curves (Coons 1967): what they bound, if nothing better is known.

/** @typedef {number[][]} Line rows of x, y, z */

/** @param {number[]} p @param {number[]} q */
const isSame = (p, q) => p.every((value, k) => value === q[k]);

/** @param {Line} line */
const reverse = (line) => [...line].reverse();

/** Turns lines so that each starts where the one before ends. @param {Line[]} lines */
function turn(lines) {
  const [second] = lines.slice(1);
  const isForward = isSame(lines[0][lines[0].length - 1], second[0]) || isSame(lines[0][lines[0].length - 1], second[second.length - 1]);
  const ring = [isForward ? lines[0] : reverse(lines[0])];
  for (const line of lines.slice(1)) ring.push(isSame(line[0], ring[ring.length - 1].at(-1) ?? []) ? line : reverse(line));
  return ring;
}

/** @param {Line} line @param {number} share */
function at(line, share) {
  const place = share * (line.length - 1);
  const i = Math.min(line.length - 2, Math.floor(place));
  return line[i].map((value, k) => value + (place - i) * (line[i + 1][k] - value));
}

/**
 * Points of the patch, about as far apart as a step.
 * @param {Line[]} sides four, in order round it
 * @param {number} step
 */
export function* coonsPoints(sides, step) {
  const [south, east, top, back] = turn(sides);
  const [north, west] = [reverse(top), reverse(back)];
  const lengthOf = (/** @type {Line} */ line) => line.slice(1).reduce((sum, point, i) => sum + Math.hypot(...point.map((value, k) => value - line[i][k])), 0);
  const [columns, rows] = [[south, north], [east, west]].map((pair) => Math.max(1, Math.ceil(Math.max(...pair.map(lengthOf)) / step)));
  const corners = [south[0], at(south, 1), north[0], at(north, 1)];
  for (let i = 0; i <= columns; i++) {
    const u = i / columns;
    const [low, high] = [at(south, u), at(north, u)];
    for (let j = 0; j <= rows; j++) {
      const v = j / rows;
      const [left, right] = [at(west, v), at(east, v)];
      yield low.map((value, k) => (1 - v) * value + v * high[k] + (1 - u) * left[k] + u * right[k]
        - (1 - u) * (1 - v) * corners[0][k] - u * (1 - v) * corners[1][k] - (1 - u) * v * corners[2][k] - u * v * corners[3][k]);
    }
  }
}
