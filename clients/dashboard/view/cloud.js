// Normals of a point set: of each point, the direction in which its neighbours spread least (Hoppe et al. 1992, section
// 3.1). The points are sorted by the cells of a grid, row by row: the cells round one are three in each of nine rows, and
// a sweep over all cells moves nine places onward through the sorted points.

/** Points of a cloud that are drawn by one call. */
export const CLOUD_PIECE = 131072;
const MOST_NEIGHBOURS = 24;
const FEWEST_NEIGHBOURS = 6;
const MOST_CANDIDATES = 128;
/** About eighteen points of a surface lie within this many spacings. */
const CELL_SPACINGS = 2.4;
const MOST_CELLS = 1500;

/**
 * The order of keys, by three passes of eleven bits.
 * @param {Uint32Array} keys
 */
function sortOrder(keys) {
  let order = new Uint32Array(keys.length).map((_, place) => place);
  let sorted = new Uint32Array(keys.length);
  for (const shift of [0, 11, 22]) {
    const next = new Uint32Array(2049);
    for (const key of keys) next[((key >>> shift) & 2047) + 1]++;
    for (let digit = 1; digit <= 2048; digit++) next[digit] += next[digit - 1];
    for (const place of order) sorted[next[(keys[place] >>> shift) & 2047]++] = place;
    [order, sorted] = [sorted, order];
  }
  return order;
}

/** The box of points. @param {Float32Array} points rows of x, y, z */
function boxOf(points) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0, k = 0; i < points.length; i++, k = k === 2 ? 0 : k + 1) {
    if (points[i] < low[k]) low[k] = points[i];
    if (points[i] > high[k]) high[k] = points[i];
  }
  return { low, extent: Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1, high };
}

/**
 * The cell of each point, as one number. A margin of a cell on each side sees to it that no neighbour is in another row.
 * @param {Float32Array} points
 * @param {{ low: number[], high: number[] }} box
 * @param {number} size
 */
function cellsOf(points, { low, high }, size) {
  const sides = low.map((value, k) => Math.floor((high[k] - value) / size) + 3);
  const keys = new Uint32Array(points.length / 3);
  for (let p = 0; p < keys.length; p++) {
    const i = Math.floor((points[3 * p] - low[0]) / size), j = Math.floor((points[3 * p + 1] - low[1]) / size);
    keys[p] = ((i + 1) * sides[1] + j + 1) * sides[2] + Math.floor((points[3 * p + 2] - low[2]) / size) + 1;
  }
  return { keys, sides };
}

/**
 * About how far neighbours are apart, as if they lay evenly on a surface: one of area A meets 1.5 A / s^2 cells of size s in
 * the mean over all directions.
 * @param {Float32Array} points
 * @param {ReturnType<typeof boxOf>} [box]
 */
export function findSpacing(points, box = boxOf(points)) {
  const count = points.length / 3;
  const size = Math.max((3 * box.extent) / Math.sqrt(count), box.extent / MOST_CELLS);
  const occupied = new Set(cellsOf(points, box, size).keys).size;
  return Math.sqrt((occupied * size * size) / 1.5 / count);
}

/** @param {Float32Array} points rows of x, y, z, about as large as 1 */
function makeGrid(points) {
  const box = boxOf(points);
  const spacing = findSpacing(points, box);
  const size = Math.max(CELL_SPACINGS * spacing, box.extent / MOST_CELLS);
  const { keys, sides } = cellsOf(points, box, size);
  const order = sortOrder(keys);
  const sortedKeys = keys.map((_, place) => keys[order[place]]);
  const sorted = new Float32Array(points.length);
  for (let place = 0; place < keys.length; place++) {
    for (let k = 0; k < 3; k++) sorted[3 * place + k] = points[3 * order[place] + k];
  }
  return { order, keys: sortedKeys, points: sorted, size, spacing, rowLength: sides[2], layerLength: sides[1] * sides[2] };
}

/**
 * @param {Float32Array} cloud rows of x, y, z
 * @returns {{ normals: Int8Array, spacing: number }} rows of four bytes; spacing: about the distance of neighbours
 */
export function cloudNormals(cloud) {
  const { order, keys, points, size, spacing, rowLength, layerLength } = makeGrid(cloud);
  const normals = new Int8Array((4 * cloud.length) / 3);
  const rows = [-1, 0, 1].flatMap((i) => [-1, 0, 1].map((j) => i * layerLength + j * rowLength));
  const at = new Uint32Array(9);
  const candidates = new Uint32Array(MOST_CANDIDATES);
  const near = new Uint32Array(MOST_NEIGHBOURS);
  for (let from = 0, to = 0; from < keys.length; from = to) {
    const key = keys[from];
    while (to < keys.length && keys[to] === key) to++;
    let count = 0;
    for (let row = 0; row < 9; row++) {
      const first = key + rows[row] - 1;
      let place = at[row];
      while (place < keys.length && keys[place] < first) place++;
      at[row] = place;
      // Of a crowded row only some, so that each row has its share.
      for (const end = count + 14; place < keys.length && keys[place] <= first + 2 && count < end; place++) candidates[count++] = place;
    }
    for (let place = from; place < to; place++) {
      const x = points[3 * place], y = points[3 * place + 1], z = points[3 * place + 2];
      let found = 0;
      for (let c = 0; c < count && found < MOST_NEIGHBOURS; c++) {
        const q = 3 * candidates[c];
        const dx = points[q] - x, dy = points[q + 1] - y, dz = points[q + 2] - z;
        if (dx * dx + dy * dy + dz * dz <= size * size) near[found++] = candidates[c];
      }
      if (found < FEWEST_NEIGHBOURS) { // too few for a plane: those farther away as well
        found = Math.min(count, MOST_NEIGHBOURS);
        near.set(candidates.subarray(0, found));
      }
      writeNormal(points, near, found, normals, 4 * order[place]);
    }
  }
  return { normals, spacing };
}

/**
 * The eigenvector of the least eigenvalue of the neighbours' covariance: the widest cross product of two rows of C - e I,
 * with e from the characteristic polynomial (Smith 1961).
 * @param {Float32Array} points
 * @param {Uint32Array} near
 * @param {number} count
 * @param {Int8Array} out
 * @param {number} at
 */
function writeNormal(points, near, count, out, at) {
  if (count < 4) return; // all zero: such a disc looks at the viewer
  let mx = 0, my = 0, mz = 0;
  for (let n = 0; n < count; n++) {
    mx += points[3 * near[n]];
    my += points[3 * near[n] + 1];
    mz += points[3 * near[n] + 2];
  }
  mx /= count;
  my /= count;
  mz /= count;
  let xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  for (let n = 0; n < count; n++) {
    const x = points[3 * near[n]] - mx, y = points[3 * near[n] + 1] - my, z = points[3 * near[n] + 2] - mz;
    xx += x * x;
    xy += x * y;
    xz += x * z;
    yy += y * y;
    yz += y * z;
    zz += z * z;
  }
  const mean = (xx + yy + zz) / 3;
  const a = xx - mean, b = yy - mean, c = zz - mean;
  const spread = Math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6);
  if (spread === 0) return;
  const half = (a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)) / (2 * spread ** 3);
  const angle = Math.acos(Math.max(-1, Math.min(1, half))) / 3;
  const least = mean + 2 * spread * Math.cos(angle + (2 * Math.PI) / 3);
  const r0 = [xx - least, xy, xz], r1 = [xy, yy - least, yz], r2 = [xz, yz, zz - least];
  let best = 0;
  for (let pair = 0; pair < 3; pair++) {
    const u = pair < 2 ? r0 : r1, v = pair === 0 ? r1 : r2;
    const x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    const length = Math.sqrt(x * x + y * y + z * z);
    if (length <= best) continue;
    best = length;
    out[at] = (127 * x) / length;
    out[at + 1] = (127 * y) / length;
    out[at + 2] = (127 * z) / length;
  }
}
