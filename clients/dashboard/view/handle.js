// A handle: vertices near a point go with it, those farther away less and less.

/**
 * @param {Float64Array} points rows of x, y, z
 * @param {number[]} centre
 * @param {number} radius
 * @param {number[]} offset of the centre
 * @returns {{ indices: number[], positions: [number, number, number][] }} of the vertices within the radius
 */
export function moveVertices(points, centre, radius, offset) {
  /** @type {number[]} */
  const indices = [];
  /** @type {[number, number, number][]} */
  const positions = [];
  for (let vertex = 0; 3 * vertex < points.length; vertex++) {
    const [x, y, z] = [points[3 * vertex], points[3 * vertex + 1], points[3 * vertex + 2]];
    const share = ((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2) / radius ** 2;
    if (share >= 1) continue;
    const weight = (1 - share) ** 2;
    indices.push(vertex);
    positions.push([x + weight * offset[0], y + weight * offset[1], z + weight * offset[2]]);
  }
  return { indices, positions };
}
