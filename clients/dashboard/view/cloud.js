// Normals of a point set: of each point, the direction in which its neighbours spread least (Hoppe et al. 1992, section
// 3.1). The neighbours are found by a grid of cells.

const MOST_NEIGHBOURS = 24;

/**
 * A grid whose cells hold a few points each on a surface.
 * @param {Float32Array} points rows of x, y, z, about as large as 1
 */
function makeGrid(points) {
  const count = points.length / 3;
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i++) {
    const k = i % 3;
    if (points[i] < low[k]) low[k] = points[i];
    if (points[i] > high[k]) high[k] = points[i];
  }
  const extent = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
  const size = (1.5 * extent) / Math.sqrt(count);
  const tableSize = 2 ** Math.ceil(Math.log2(count + 1));
  const first = new Uint32Array(tableSize + 1);
  const cellOf = (/** @type {number} */ i, /** @type {number} */ j, /** @type {number} */ k) =>
    ((Math.imul(i, 73856093) ^ Math.imul(j, 19349663) ^ Math.imul(k, 83492791)) >>> 0) % tableSize;
  const placeOf = (/** @type {number} */ point, /** @type {number} */ k) => Math.floor((points[3 * point + k] - low[k]) / size);
  const cells = new Uint32Array(count);
  for (let p = 0; p < count; p++) {
    cells[p] = cellOf(placeOf(p, 0), placeOf(p, 1), placeOf(p, 2));
    first[cells[p] + 1]++;
  }
  for (let c = 1; c <= tableSize; c++) first[c] += first[c - 1];
  const members = new Uint32Array(count);
  const next = first.slice();
  for (let p = 0; p < count; p++) members[next[cells[p]]++] = p;
  return { first, members, size, cellOf, placeOf };
}

/**
 * @param {Float32Array} points
 * @returns {{ normals: Int8Array, spacing: number }} rows of four bytes; spacing: about the distance of neighbours
 */
export function cloudNormals(points) {
  const { first, members, size, cellOf, placeOf } = makeGrid(points);
  const count = points.length / 3;
  const normals = new Int8Array(4 * count);
  const near = new Uint32Array(MOST_NEIGHBOURS);
  for (let p = 0; p < count; p++) {
    const [ci, cj, ck] = [placeOf(p, 0), placeOf(p, 1), placeOf(p, 2)];
    let found = 0;
    for (let i = ci - 1; i <= ci + 1; i++) {
      for (let j = cj - 1; j <= cj + 1; j++) {
        for (let k = ck - 1; k <= ck + 1; k++) {
          const cell = cellOf(i, j, k);
          for (let m = first[cell]; m < first[cell + 1]; m++) {
            const q = members[m];
            const dx = points[3 * q] - points[3 * p], dy = points[3 * q + 1] - points[3 * p + 1];
            const dz = points[3 * q + 2] - points[3 * p + 2];
            if (dx * dx + dy * dy + dz * dz > size * size) continue;
            // A crowded cell gives a sample of its points, spread over them.
            if (found < MOST_NEIGHBOURS) near[found++] = q;
            else near[Math.imul(q, 40503) % MOST_NEIGHBOURS & 15] = q;
          }
        }
      }
    }
    writeNormal(points, near, found, normals, 4 * p);
  }
  return { normals, spacing: size / 1.5 };
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
  for (const [u, v] of [[r0, r1], [r0, r2], [r1, r2]]) {
    const x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    const length = Math.sqrt(x * x + y * y + z * z);
    if (length <= best) continue;
    best = length;
    out[at] = (127 * x) / length;
    out[at + 1] = (127 * y) / length;
    out[at + 2] = (127 * z) / length;
  }
}
