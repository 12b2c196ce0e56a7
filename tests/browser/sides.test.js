// How the page proves sides, without a browser: exact signs, winding numbers, and the signed distances that are drawn, against references
// that are made without its code.

import assert from "node:assert/strict";
import { test } from "node:test";

import { sideOfLine, sideOfPlane } from "../../clients/dashboard/view/exact.js";
import { drawnTriangles, heatPieces } from "../../clients/dashboard/view/heat.js";
import { provenSides } from "../../clients/dashboard/view/proof.js";
import { Winding } from "../../clients/dashboard/view/winding.js";
import { cornerNormals, faceNormals, facesOfVertices } from "../../clients/dashboard/view/topology.js";
import { ball, box, chance, moved, shapeOf, sphere, well } from "./support/shapes.js";

const SEED = Number(process.env.QM_SEED ?? 1 + Math.floor(1e6 * Math.random()));
const random = chance(SEED);

/** A double as a fraction: its numerator over 2^1074. */
function fraction(x) {
  let power = 1074;
  let whole = Math.abs(x);
  while (!Number.isInteger(whole)) {
    whole *= 2;
    power -= 1;
  }
  return BigInt(Math.sign(x)) * BigInt(whole) * 2n ** BigInt(power);
}
const signOf = (x) => (x > 0n ? 1 : x < 0n ? -1 : 0);
const minus = (one, other) => one.map((x, k) => x - other[k]);

test("signs of lines and planes are exact, also where points nearly lie on them", () => {
  const counts = { 0: 0, 1: 0, "-1": 0 };
  for (let n = 0; n < 6000; n++) {
    const size = 10 ** (40 * random() - 20);
    const coordinate = () => [() => size * (random() - 0.5), () => Math.floor(8 * random()) * size, () => Math.floor(4 * random()) / 10][n % 3]();
    const [a, b, c] = [0, 1, 2].map(() => [coordinate(), coordinate(), coordinate()]);
    const [u, v] = [random(), random()];
    // Near the plane, or a corner of the figure.
    const p = n % 5 === 0 ? [...b] : a.map((x, k) => x + u * (b[k] - x) + v * (c[k] - x));
    const [fa, fb, fc, fp] = [a, b, c, p].map((point) => point.map(fraction));
    const [x, y, z] = [fb, fc, fp].map((point) => minus(point, fa));
    const volume = z[0] * (x[1] * y[2] - x[2] * y[1]) + z[1] * (x[2] * y[0] - x[0] * y[2]) + z[2] * (x[0] * y[1] - x[1] * y[0]);
    assert.equal(sideOfPlane(a, b, c, p), signOf(volume), `seed ${SEED}, ${n}`);
    assert.equal(sideOfLine(a[0], a[1], b[0], b[1], p[0], p[1]), signOf(x[0] * z[1] - x[1] * z[0]), `seed ${SEED}, ${n}`);
    counts[signOf(volume)]++;
  }
  assert(Object.values(counts).every((count) => count > 300), `seed ${SEED}: ${JSON.stringify(counts)}`);
});

test("winding numbers are right where the ray runs along faces, through edges and corners", () => {
  const turned = (mesh) => ({ ...mesh, faces: mesh.faces.map((corners) => [...corners].reverse()) });
  const lattice = (n) => Math.floor(n * random()) / 8 - 0.25;
  const inBox = ([x, y, z]) => [x, y, z].every((value) => value > 0 && value < 1);
  const onBox = (point) => point.every((value) => value >= 0 && value <= 1) && !inBox(point);
  const hole = ([x, y, z]) => [x > 0.25 && x < 0.75 && y > 0.25 && y < 0.75, z > 0.5];
  const cut = well(0.5);
  cut.vertices = cut.vertices.map(([x, y, z]) => [x === 0.3 ? 0.25 : x === 0.7 ? 0.75 : x, y === 0.3 ? 0.25 : y === 0.7 ? 0.75 : y, z]);
  for (const shift of [0, 2 ** 30]) {
    const [plain, inside_out, welled] = [box(4), turned(box(4)), cut].map((mesh) => new Winding(shapeOf(moved(mesh, [shift, -shift, shift])), false));
    let count = 0;
    for (let n = 0; n < 3000; n++) {
      const point = [lattice(13), lattice(13), lattice(13)];
      const at = point.map((x, k) => x + (k === 1 ? -shift : shift));
      if (onBox(point)) continue;
      assert.equal(plain.of(at), inBox(point) ? 1 : 0, `${point}`);
      assert.equal(inside_out.of(at), inBox(point) ? -1 : 0, `${point}`);
      const [isBeside, isAbove] = hole(point);
      const [x, y, z] = point;
      const onHole = z >= 0.5 && z <= 1 && x >= 0.25 && x <= 0.75 && y >= 0.25 && y <= 0.75 && !(isBeside && isAbove);
      if (!onHole) assert.equal(welled.of(at), inBox(point) && !(isBeside && isAbove) ? 1 : 0, `${point}`);
      count += Number(inBox(point));
    }
    assert(count > 300, `seed ${SEED}`);
  }
});

test("two shells that lie in one another count, and a cavity does not", () => {
  const inner = ball(6);
  const join = (...meshes) => meshes.reduce((all, mesh) => ({
    vertices: [...all.vertices, ...mesh.vertices], faces: [...all.faces, ...mesh.faces.map((corners) => corners.map((corner) => corner + all.vertices.length))] }));
  const outer = { ...ball(6), vertices: ball(6).vertices.map((point) => point.map((x) => 2 * x)) };
  const flipped = { ...inner, faces: inner.faces.map((corners) => [...corners].reverse()) };
  const [both, hollow] = [join(outer, inner), join(outer, flipped)].map((mesh) => new Winding(shapeOf(mesh), false));
  assert.deepEqual([[0, 0, 0], [1.4, 0, 0], [3, 0, 0]].map((point) => [both.of(point), hollow.of(point)]), [[2, 0], [1, 1], [0, 0]]);
});

test("by a patch that is not flat the sides of its two triangles are not taken", () => {
  const mesh = box(1);
  mesh.vertices = mesh.vertices.map((point) => (point.every((x) => x === 1) ? point.map((x) => x * 1.5) : point));
  const [triangles, patches] = [false, true].map((isBilinear) => new Winding(shapeOf(mesh), isBilinear));
  // The side of x = 1 has the corners (1, 0, 0), (1, 1, 0), (1.5, 1.5, 1.5) and (1, 0, 1): its patch passes the middle at x = 1.125.
  for (const far of [[0.5, 0.5, 0.5], [1.4, 0.2, 0.2], [-1, 0.5, 0.5]]) {
    const isInside = far[0] === 0.5 ? 1 : 0;
    assert.deepEqual([triangles.of(far), patches.of(far)], [isInside, isInside], far.join());
  }
  for (const near of [[1.125, 0.625, 0.625], [1.15, 0.65, 0.6]]) {
    assert.notEqual(triangles.of(near), null);
    assert.equal(patches.of(near), null, near.join());
  }
});

/** The signed distance from the box from 0 to 1, positive outside, and its nearest point. */
function toBox(point) {
  const foot = point.map((x) => Math.max(0, Math.min(1, x)));
  const away = Math.hypot(...point.map((x, k) => x - foot[k]));
  if (away > 0) return { signed: away, foot };
  const sides = point.flatMap((x, k) => [[x, k, 0], [1 - x, k, 1]]).sort(([one], [other]) => one - other);
  const [depth, axis, end] = sides[0];
  return { signed: -depth, foot: point.map((x, k) => (k === axis ? end : x)) };
}

test("the signed distances that are drawn are right to the errors that are stated, also where triangles pass through the solid", async () => {
  const solid = new Winding(shapeOf(box(3)), false);
  const feet = async (points) => {
    const count = points.length / 3;
    const all = Array.from({ length: count }, (_, n) => toBox([...points.subarray(3 * n, 3 * n + 3)]));
    return { distance: Float64Array.from(all, ({ signed }) => Math.abs(signed)), foot: Float64Array.from(all.flatMap(({ foot }) => foot)), face: new Int32Array(count) };
  };
  let crossing = 0;
  for (let n = 0; n < 60; n++) {
    const point = () => [0, 1, 2].map(() => 3 * random() - 1);
    const shape = shapeOf(n % 4 === 0 ? moved(sphere(0, 4, 8), [0.5 + random(), 0.5, 0.5]) : { vertices: [point(), point(), point(), point()], faces: [[0, 1, 2], [1, 0, 3]] });
    const refined = drawnTriangles(shape, 1);
    await refined.refine(feet, { target: n % 3 === 0 ? 0.02 : 10, most: 400, flat: null, isSigned: n % 2 === 0, isWanted: () => true });
    const sides = provenSides(refined, solid);
    sides.forEach((side, vertex) => {
      const { signed } = toBox([...refined.points.subarray(3 * vertex, 3 * vertex + 3)]);
      if (Math.abs(signed) > 1e-9) assert.equal(side, Math.sign(signed), `seed ${SEED}, ${n}`);
    });
    const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
    const frame = { centre: [0, 0, 0], scale: 1 };
    refined.isCut = true;
    for (const { position, value } of heatPieces({ shape, steps: 1, frame, tints: null, normals }, refined, sides)) {
      for (let t = 0; 9 * t < position.length; t++) {
        for (let k = 0; k < 12; k++) {
          const cuts = [random(), random()].sort((one, other) => one - other);
          const weights = [cuts[0], cuts[1] - cuts[0], 1 - cuts[1]];
          const mix = (of) => weights.reduce((sum, weight, corner) => sum + weight * of(3 * t + corner), 0);
          const { signed } = toBox([0, 1, 2].map((axis) => mix((corner) => position[3 * corner + axis])));
          const [shown, error] = [mix((corner) => value[2 * corner]), value[6 * t + 1]];
          assert(Math.abs(shown - signed) <= error + 1e-6, `seed ${SEED}, ${n}: ${shown} is off from ${signed} by more than ${error}`);
          const corners = [0, 1, 2].map((corner) => Math.sign(value[2 * (3 * t + corner)]));
          if (corners.every((sign) => sign !== 0 && sign !== Math.sign(signed))) crossing++;
        }
      }
    }
  }
  assert(crossing > 10, `seed ${SEED}: ${crossing} samples on another side than all corners`);
});
