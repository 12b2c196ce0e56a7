// The shapes of the sample pairs by formulas, as OBJ.

/** @typedef {(point: number[]) => number[]} Shape of points of a box from -1 to 1 */

/** The unit ball's point in the same direction. @type {Shape} */
const onBall = (point) => point.map((x) => x / Math.hypot(...point));

/** A block whose edges are rounded with a radius of 0.4. @type {Shape} */
function onBlock(point) {
  const core = point.map((x) => Math.max(-0.6, Math.min(0.6, x)));
  const away = point.map((x, k) => x - core[k]);
  const far = Math.hypot(...away) || 1;
  return core.map((x, k) => [1.5, 1, 0.7][k] * (x + (0.4 * away[k]) / far));
}

/** The block as it was made: a dent in its top, and an end that is too thick. @type {Shape} */
function onDentedBlock(point) {
  const [x, y, z] = onBlock(point);
  const dent = z > 0 ? 0.12 * Math.exp(-20 * ((x - 0.5) ** 2 + (y - 0.2) ** 2)) : 0;
  return [x < -0.8 ? x + 0.15 * (x + 0.8) : x, y, z - dent];
}

/** A ball with hills and hollows. @type {Shape} */
function onHills(point) {
  const [x, y, z] = onBall(point);
  const radius = 1 + 0.16 * Math.sin(3 * x + 1) * Math.cos(2.5 * y) + 0.12 * Math.sin(4 * z + 2 * y);
  return [1.3 * radius * x, radius * y, 0.9 * radius * z];
}

/** @type {Record<string, Shape>} */
const SHAPES = { block: onBlock, dented: onDentedBlock, hills: onHills };

/** The sides of a box, a grid of quads each, in a shape, as OBJ. @param {number} steps @param {string} name of the shape */
export function objOf(steps, name) {
  const shape = SHAPES[name];
  /** @type {string[]} */
  const vertices = [], faces = [];
  /** @type {Map<string, number>} */
  const places = new Map();
  const at = (/** @type {number[]} */ point) => {
    const key = point.join();
    if (!places.has(key)) {
      places.set(key, vertices.push(`v ${shape(point.map((x) => (2 * x) / steps - 1)).map((x) => Number(x.toFixed(9))).join(" ")}`));
    }
    return places.get(key);
  };
  for (const [u, v, w] of [[0, 1, 2], [1, 2, 0], [2, 0, 1]]) {
    for (const side of [0, steps]) {
      for (let cell = 0; cell < steps * steps; cell++) {
        const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(([i, j]) => {
          const point = [0, 0, 0];
          [point[u], point[v], point[w]] = [Math.floor(cell / steps) + i, (cell % steps) + j, side];
          return at(point);
        });
        faces.push(`f ${(side ? corners : corners.reverse()).join(" ")}`);
      }
    }
  }
  return `${[...vertices, ...faces].join("\n")}\n`;
}
