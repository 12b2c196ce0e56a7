// What the 3D view's worker computes, without a browser: triangles of faces, normals, irregular vertices, colours.

import assert from "node:assert/strict";
import { test } from "node:test";

import { cloudNormals } from "../../clients/dashboard/view/cloud.js";
import { patchTint, scaleColour, signedColour } from "../../clients/dashboard/view/colours.js";
import { colourCells, fillCells } from "../../clients/dashboard/view/regions.js";
import { Sides } from "../../clients/dashboard/view/sides.js";
import { buildPiece, gridSteps, pieces } from "../../clients/dashboard/view/soup.js";
import { cornerNormals, faceNormals, facesOfVertices, irregularVertices } from "../../clients/dashboard/view/topology.js";
import { box, boxLayout, chance, shapeOf, sheet, sphere } from "./support/shapes.js";

const FRAME = { centre: [0.5, 0.5, 0.5], scale: 2 };

function build(shape, steps) {
  const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
  return [...pieces(shape, steps)].map((run) => ({ run, ...buildPiece(shape, normals, null, FRAME, steps, run) }));
}

function areaOf(position) {
  let area = 0;
  for (let t = 0; t < position.length; t += 9) {
    const [u, v] = [3, 6].map((k) => [0, 1, 2].map((d) => position[t + k + d] - position[t + d]));
    area += Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
  }
  return area;
}

test("a box keeps its area, its creases and its edges, as triangles and as patches", () => {
  const shape = shapeOf(box(8));
  for (const steps of [1, 3]) {
    const [piece] = build(shape, steps);
    assert.equal(piece.position.length, 384 * 2 * steps * steps * 9);
    assert(Math.abs(areaOf(piece.position) - 6 * FRAME.scale ** 2) < 1e-5);
    for (let n = 0; n < piece.normal.length; n += 4) {
      assert.equal(Math.max(...[0, 1, 2].map((k) => Math.abs(piece.normal[n + k]))), 127);
    }
    // An edge of the face is drawn along a triangle's side where two of its corners have 0 for it.
    let sides = 0;
    for (let t = 0; t < piece.edge.length; t += 12) {
      for (let k = 0; k < 3; k++) if ([0, 1, 2].filter((corner) => piece.edge[t + 4 * corner + k] === 0).length === 2) sides++;
    }
    assert.equal(sides, 384 * 4 * steps);
  }
});

test("irregular vertices are the eight corners of a box, and none of a sheet or a sphere", () => {
  const found = (mesh) => {
    const shape = shapeOf(mesh);
    return irregularVertices(shape, facesOfVertices(shape));
  };
  assert.deepEqual(found(box(4)).valences, [3, 3, 3, 3, 3, 3, 3, 3]);
  assert.equal(found(sheet(4, 4)).vertices.length, 0);
  assert.equal(found(sphere(0, 10, 20)).vertices.length, 0);
});

test("large meshes come in pieces that together are whole", () => {
  const shape = shapeOf(sheet(300, 200));
  const runs = [...pieces(shape, 1)];
  assert.equal(runs.length, 3);
  assert.equal(runs.reduce((sum, run) => sum + run.triangles, 0), 120000);
  runs.forEach((run, place) => assert.equal(run.from, place === 0 ? 0 : runs[place - 1].to));
  assert.equal(gridSteps(100000, true), 2);
  assert.equal(gridSteps(10, true), 8);
  assert.equal(gridSteps(10, false), 1);
});

test("normals of points on a sphere point to its centre", () => {
  const random = chance(3);
  const points = new Float32Array(3 * 20000);
  for (let p = 0; p < 20000; p++) {
    const z = 2 * random() - 1;
    const angle = 2 * Math.PI * random();
    const radius = Math.sqrt(1 - z * z);
    points.set([0.5 * radius * Math.cos(angle), 0.5 * radius * Math.sin(angle), 0.5 * z], 3 * p);
  }
  const { normals, spacing } = cloudNormals(points);
  let known = 0;
  let good = 0;
  for (let p = 0; p < 20000; p++) {
    const dot = [0, 1, 2].reduce((sum, k) => sum + (normals[4 * p + k] / 127) * (points[3 * p + k] / 0.5), 0);
    if (dot !== 0) known++;
    if (Math.abs(dot) > 0.97) good++;
  }
  assert(known > 19500 && good > 0.98 * known, `seed 3: ${known} ${good}`);
  assert(spacing > 0.003 && spacing < 0.03);
});

test("few points, equal points and points on a line are no trouble", () => {
  for (const points of [[], [1, 2, 3], new Array(300).fill(0.25), Array.from({ length: 300 }, (_, i) => (i % 3 ? 0 : i / 300))]) {
    const { normals } = cloudNormals(Float32Array.from(points));
    assert.equal(normals.length, (4 * points.length) / 3);
  }
});

test("the scale's lightness only grows, and patches that are neighbours in number differ", () => {
  const lightness = ([r, g, b]) => 0.2126 * r ** 2.2 + 0.7152 * g ** 2.2 + 0.0722 * b ** 2.2;
  for (let i = 1; i <= 64; i++) assert(lightness(scaleColour(i / 64)) > lightness(scaleColour((i - 1) / 64)), `${i}`);
  for (let i = 0; i < 50; i++) {
    const [one, two] = [patchTint(i), patchTint(i + 1)];
    assert(Math.hypot(...one.map((value, k) => value - two[k])) > 40);
  }
});

test("points lie inside or outside a box, also where their feet are on its edges and corners", () => {
  const shape = shapeOf(box(3));
  const sides = new Sides(shape);
  const random = chance(5);
  const counted = [0, 0];
  for (let n = 0; n < 3000; n++) {
    // Many coordinates beyond the box, so that feet fall on all kinds of places.
    const point = [0, 1, 2].map(() => 2 * random() - 0.5);
    const isInside = point.every((x) => x > 0 && x < 1);
    const foot = point.map((x) => Math.max(0, Math.min(1, x)));
    if (isInside) {
      const depths = point.flatMap((x) => [x, 1 - x]);
      const place = depths.indexOf(Math.min(...depths));
      foot[place >> 1] = place & 1;
    }
    const isOn = (face) => shape.corners.subarray(shape.starts[face], shape.starts[face + 1]).reduce((low, vertex) =>
      low.map(([least, most], k) => [Math.min(least, shape.points[3 * vertex + k]), Math.max(most, shape.points[3 * vertex + k])]),
    [[2, -2], [2, -2], [2, -2]]).every(([least, most], k) => foot[k] >= least && foot[k] <= most);
    const faces = [...Array(shape.starts.length - 1).keys()].filter(isOn);
    assert(faces.length > 0);
    for (const face of faces) assert.equal(sides.sideOf(point, foot, face), isInside ? -1 : 1, `${point}`);
    counted[Number(isInside)]++;
  }
  assert(counted.every((count) => count > 200), `${counted}`);
});

test("the curves of its layout separate the sides of a box, of a mesh and of points", () => {
  const { curves, nodes } = boxLayout();
  const frame = { centre: [0.5, 0.5, 0.5], scale: 1 / Math.sqrt(3) };
  const shape = shapeOf(box(40));
  const cloud = { ...shape, corners: new Uint32Array(0), starts: new Uint32Array(1) };
  // The low and the high side along x.
  const patches = [0, 1].map((x) => ({
    sides: curves.filter(({ from, to }) => nodes[from][0] === x && nodes[to][0] === x).map(({ id }) => id),
    middle: [x, 0.5, 0.5], tint: [10 + x, 0, 0] }));
  for (const surface of [shape, cloud]) {
    const { colours, sides, low, size } = colourCells(fillCells(surface, frame), frame, { curves, patches });
    const tintAt = (point) => {
      const [i, j, k] = point.map((value, axis) => Math.floor((0.999 * (value - 0.5) * frame.scale - low[axis]) / size));
      return colours[4 * ((k * sides[1] + j) * sides[0] + i)];
    };
    for (const [y, z] of [[0.5, 0.5], [0.2, 0.7], [0.8, 0.15]]) {
      assert.deepEqual([tintAt([0, y, z]), tintAt([1, y, z]), tintAt([y, 0, z]), tintAt([y, z, 1])], [10, 11, 0, 0]);
    }
  }
});

test("a patch one of whose curves leaves the surface is coloured where its four curves lead", () => {
  const corners = [[0, 0.2, 0.2], [0, 0.8, 0.2], [0, 0.8, 0.8], [0, 0.2, 0.8]];
  const curves = corners.map((from, id) => {
    const to = corners[(id + 1) % 4];
    const points = Array.from({ length: 21 }, (_, i) => from.map((value, k) => value + ((to[k] - value) * i) / 20));
    if (id === 0) for (const point of points.slice(3, -3)) point[0] = 0.035; // under the surface
    return { id, points: id % 2 ? points : points.reverse() };
  });
  const frame = { centre: [0.5, 0.5, 0.5], scale: 1 / Math.sqrt(3) };
  const patches = [{ sides: [0, 1, 2, 3], middle: [0, 0.5, 0.5], tint: [9, 0, 0] }];
  const { colours, sides, low, size } = colourCells(fillCells(shapeOf(box(40)), frame), frame, { curves, patches });
  const tintAt = (point) => {
    const [i, j, k] = point.map((value, axis) => Math.floor((0.999 * (value - 0.5) * frame.scale - low[axis]) / size));
    return colours[4 * ((k * sides[1] + j) * sides[0] + i)];
  };
  assert.deepEqual([[0.5, 0.5], [0.3, 0.7], [0.7, 0.75], [0.1, 0.5], [0.5, 0.9]].map(([y, z]) => tintAt([0, y, z])), [9, 9, 9, 0, 0]);
  assert.equal(tintAt([1, 0.5, 0.5]), 0);
});

test("the scale of signed distances is grey in the middle and as dark on both sides", () => {
  const light = (share) => signedColour(share).reduce((sum, value) => sum + value, 0);
  const [r, g, b] = signedColour(0.5);
  assert(Math.max(r, g, b) - Math.min(r, g, b) < 0.02);
  for (const away of [0.1, 0.3, 0.5]) assert(light(0.5 + away) < light(0.5) && light(0.5 - away) < light(0.5));
  assert(signedColour(0)[2] > signedColour(0)[0] && signedColour(1)[0] > signedColour(1)[2]);
});
