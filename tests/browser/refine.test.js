// Distances between vertices: what the page says of the error of its colours, against a nearest point found the slow way.

import assert from "node:assert/strict";
import { test } from "node:test";

import { FlatFaces } from "../../clients/dashboard/view/flat.js";
import { drawnTriangles, heatPieces, worstError } from "../../clients/dashboard/view/heat.js";
import { Sides } from "../../clients/dashboard/view/sides.js";
import { cornerNormals, faceNormals, facesOfVertices } from "../../clients/dashboard/view/topology.js";
import { ball, box, chance, moved, shapeOf } from "./support/shapes.js";

const SEED = Number(process.env.QM_TEST_SEED ?? 11);
const minus = (a, b) => a.map((value, k) => value - b[k]);
const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const along = (a, b, t) => a.map((value, k) => value + t * (b[k] - value));
const clamp = (x) => Math.max(0, Math.min(1, x));

/** The nearest point of a triangle: inside it, or else on one of its sides. */
function nearestOfTriangle(p, [a, b, c]) {
  const [u, v, w] = [minus(b, a), minus(c, a), minus(p, a)];
  const [uu, uv, vv, wu, wv] = [dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)];
  const [s, t] = [(wu * vv - wv * uv) / (uu * vv - uv * uv), (wv * uu - wu * uv) / (uu * vv - uv * uv)];
  if (s >= 0 && t >= 0 && s + t <= 1) return a.map((value, k) => value + s * u[k] + t * v[k]);
  const feet = [[a, b], [b, c], [c, a]].map(([from, to]) => along(from, to, clamp(dot(minus(p, from), minus(to, from)) / dot(minus(to, from), minus(to, from)))));
  return feet.reduce((best, foot) => (Math.hypot(...minus(p, foot)) < Math.hypot(...minus(p, best)) ? foot : best));
}

const trianglesOf = ({ vertices, faces }) => faces.flatMap((face, place) => face.slice(2).map((_, k) =>
  ({ face: place, corners: [face[0], face[k + 1], face[k + 2]].map((vertex) => vertices[vertex]) })));

/** Feet on a mesh, by looking at every triangle. */
function slowFeet(mesh) {
  const all = trianglesOf(mesh);
  return (p) => all.reduce((best, { face, corners }) => {
    const foot = nearestOfTriangle(p, corners);
    const distance = Math.hypot(...minus(p, foot));
    return distance < best.distance ? { distance, foot, face } : best;
  }, { distance: Infinity });
}

async function refined(a, b, limits) {
  const shape = shapeOf(a);
  const cut = drawnTriangles(shape, 1);
  const feetOf = slowFeet(b);
  const measure = async (points) => {
    const feet = Array.from({ length: points.length / 3 }, (_, n) => feetOf([...points.subarray(3 * n, 3 * n + 3)]));
    return { distance: Float64Array.from(feet, ({ distance }) => distance), foot: Float64Array.from(feet.flatMap(({ foot }) => foot)), face: Int32Array.from(feet, ({ face }) => face) };
  };
  await cut.refine(measure, { flat: new FlatFaces(shapeOf(b)), isWanted: () => true, ...limits });
  return { shape, cut, feetOf };
}

/** A flat square of one quad, and one with a hill in its middle that the square's corners know nothing of. */
const square = { vertices: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], faces: [[0, 1, 2, 3]] };
function hill(steps = 12) {
  const vertices = [];
  const faces = [];
  for (let i = 0; i <= steps; i++) {
    for (let j = 0; j <= steps; j++) {
      const r = Math.hypot(i / steps - 0.5, j / steps - 0.5);
      vertices.push([i / steps, j / steps, r < 0.4 ? 0.3 * (1 - (r / 0.4) ** 2) ** 2 : 0]);
    }
  }
  for (let i = 0; i < steps; i++) for (let j = 0; j < steps; j++) faces.push([[0, 0], [1, 0], [1, 1], [0, 1]].map(([u, v]) => (i + u) * (steps + 1) + j + v));
  return { vertices, faces };
}

const turned = ({ vertices, faces }, angle) => ({ faces, vertices: vertices.map(([x, y, z]) =>
  [x * Math.cos(angle) - y * Math.sin(angle), x * Math.sin(angle) + y * Math.cos(angle), z]) });

const PAIRS = {
  "a flat quad and a hill": [square, hill()], "a hill and a flat quad": [hill(), square],
  "a coarse ball on a fine one": [ball(2), ball(8)], "a fine ball and a coarse one": [ball(5), ball(2)],
  "two balls that cross": [moved(ball(3), [0.7, 0.2, 0.1]), ball(4)], "two boxes, one turned": [turned(box(1), 0.4), box(1)],
};

for (const [name, [a, b]] of Object.entries(PAIRS)) {
  test(`no place is farther off than is said: ${name}`, async () => {
    const { cut, feetOf } = await refined(a, b, { target: 0.01, most: 1200 });
    const random = chance(SEED);
    for (let n = 0; n < 2000; n++) {
      const t = Math.floor(random() * cut.count);
      const [u, v] = [random(), random()];
      const weights = u + v > 1 ? [u + v - 1, 1 - u, 1 - v] : [1 - u - v, u, v];
      const corners = [...cut.corners.subarray(3 * t, 3 * t + 3)];
      const point = [0, 1, 2].map((k) => corners.reduce((sum, vertex, c) => sum + weights[c] * cut.points[3 * vertex + k], 0));
      const shown = corners.reduce((sum, vertex, c) => sum + weights[c] * cut.feet.distance[vertex], 0);
      const off = Math.abs(shown - feetOf(point).distance);
      assert(off <= cut.errors[t] + 1e-12, `seed ${SEED}: ${point} is off by ${off}, said ${cut.errors[t]}`);
    }
    assert(worstError(cut, null) <= 0.01 || cut.count > 1000, `${worstError(cut, null)} with ${cut.count} triangles`);
  });
}

test("a coarse mesh whose corners lie on a scan is not at distance zero between them", async () => {
  const { cut } = await refined(square, hill(), { target: 0.02, most: 4000 });
  assert(Math.max(...cut.feet.distance.subarray(0, 4)) === 0);
  assert(Math.max(...cut.feet.distance) > 0.15, `${Math.max(...cut.feet.distance)}`);
});

test("flat faces that coincide are cut no finer, and the rest keeps the triangles to itself", async () => {
  const dent = box(4);
  dent.vertices = dent.vertices.map(([x, y, z]) => (x === 0.5 && y === 0.5 && z === 1 ? [x, y, 0.8] : [x, y, z]));
  const { cut } = await refined(dent, box(1), { target: 0.02, most: 20000 });
  assert(worstError(cut, null) <= 0.02);
  const parts = new Map();
  for (const origin of cut.origins) parts.set(origin, (parts.get(origin) ?? 0) + 1);
  const cuts = [...parts.values()].filter((count) => count > 1).length;
  assert(cuts >= 8 && cuts < 32, `${cuts} of ${parts.size}: the dent, what has a side with it, and some at edges`);
});

test("the parts of a triangle are the triangle, with its normals and the edges of its face", async () => {
  const { shape, cut } = await refined(ball(2), ball(8), { target: 0.01, most: 2000 });
  const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
  const frame = { centre: [0, 0, 0], scale: 1 };
  const areaOf = (position) => {
    let area = 0;
    for (let t = 0; t < position.length; t += 9) {
      const [u, v] = [3, 6].map((k) => [0, 1, 2].map((d) => position[t + k + d] - position[t + d]));
      area += Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
    }
    return area;
  };
  const whole = [...heatPieces({ shape, steps: 1, frame, tints: null, normals }, drawnTriangles(shape, 1), null)];
  const made = [...heatPieces({ shape, steps: 1, frame, tints: null, normals }, cut, null)];
  const sum = (pieces) => pieces.reduce((total, piece) => total + areaOf(piece.position), 0);
  assert(Math.abs(sum(made) - sum(whole)) < 1e-5 * sum(whole));
  assert.equal(made.reduce((total, piece) => total + piece.value.length / 6, 0), cut.count);
  let error = 0;
  for (const piece of made) for (let n = 1; n < piece.value.length; n += 2) error = Math.max(error, piece.value[n]);
  assert(Math.abs(error - worstError(cut, null)) < 1e-6);
});

test("no place is farther off than is said where inside and outside meet in a triangle", async () => {
  const { cut, feetOf } = await refined(moved(ball(3), [0.3, 0.1, 0]), ball(4), { target: 0.02, most: 1500 });
  const about = new Sides(shapeOf(ball(4)));
  const sideOf = (point, { foot, face }) => about.sideOf(point, foot, face);
  const pointOf = (vertex) => [...cut.points.subarray(3 * vertex, 3 * vertex + 3)];
  const sides = Int8Array.from({ length: cut.points.length / 3 }, (_, vertex) => sideOf(pointOf(vertex), feetOf(pointOf(vertex))));
  const frame = { centre: [0, 0, 0], scale: 1 };
  const shape = shapeOf(moved(ball(3), [0.3, 0.1, 0]));
  const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
  let mixed = 0;
  for (const { position, value } of heatPieces({ shape, steps: 1, frame, tints: null, normals }, cut, sides)) {
    for (let t = 0; 9 * t < position.length; t++) {
      const values = [0, 1, 2].map((k) => value[6 * t + 2 * k]);
      if (Math.min(...values) >= 0 || Math.max(...values) <= 0) continue;
      mixed++;
      for (const weights of [[1 / 3, 1 / 3, 1 / 3], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.2, 0.7, 0.1]]) {
        const mix = (of) => weights.reduce((sum, weight, k) => sum + weight * of(k), 0);
        const point = [0, 1, 2].map((x) => mix((k) => position[9 * t + 3 * k + x]));
        const found = feetOf(point);
        const off = Math.abs(mix((k) => values[k]) - sideOf(point, found) * found.distance);
        assert(off <= value[6 * t + 1] + 1e-6, `${point} is off by ${off}, said ${value[6 * t + 1]}`);
      }
    }
  }
  assert(mixed > 20, String(mixed));
});
