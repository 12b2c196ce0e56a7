// clients/js from Node against a real daemon: every call, streams that break, refusals.

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";

import { Client, ConnectionError, FOOT_WIDTH, ProblemError } from "../../clients/js/index.js";
import { LayoutTools } from "../../clients/js/layout_tools.js";
import { Daemon, until } from "./support/daemon.js";
import {
  SLOW, SPHERE_DISTANCE, SPHERE_TURN, ball, ballLayout, box, boxLayout, heaps, moved, off, ply, sphere, roundedBox,
} from "./support/shapes.js";

let daemon;
let client;
let a;
let b;

before(async () => {
  daemon = await Daemon.start();
  client = daemon.client();
  a = (await client.meshes.create(off(sphere()), { name: "a.off" })).mesh;
  b = (await client.meshes.create(ply(sphere(SPHERE_TURN)), { name: "b.ply", format: "ply" })).mesh;
});
after(() => daemon.remove());

async function collect(iterator) {
  const all = [];
  for await (const item of iterator) all.push(item);
  return all;
}

async function slowJob(of, more = {}) {
  const meshes = [];
  for (const heap of heaps()) {
    meshes.push((await of.meshes.create(off(heap), { name: "heap.off" })).mesh.id);
  }
  const [first, second] = meshes;
  return of.jobs.create({ type: "hausdorff", a: first, b: second, ...SLOW, ...more });
}

function checkBounds(events) {
  let lower = 0;
  let upper = Infinity;
  for (const { lower: l, upper: u } of events.map((event) => event.result ?? event)) {
    assert(l >= lower && (u ?? Infinity) <= upper, "bounds moved the wrong way");
    [lower, upper] = [l, u ?? Infinity];
  }
}

test("meshes: upload, list, show, download, patches, delete", async () => {
  assert.deepEqual(a.faces, { triangles: 0, quads: 4800, polygons: 0 });
  const again = await client.meshes.create(off(sphere()), { name: "a.off" });
  assert.deepEqual([again.isNew, again.mesh.id], [false, a.id]);
  assert.deepEqual(await client.meshes.get(a.id), a);
  const listed = await collect(client.meshes.list({ pageSize: 1 }));
  assert(listed.length >= 2 && listed.some((mesh) => mesh.id === b.id));

  const file = await client.meshes.content(a.id, { format: "off" });
  const back = await client.meshes.create(file.bytes, { name: "back", format: "off" });
  assert.equal(back.mesh.vertices, a.vertices);
  assert.equal(file.name, `${a.id}.off`);
  const stl = await client.meshes.content(a.id, { format: "stl" });
  assert.equal(stl.cutFaces, 4800);
  assert(stl.displacement > 0 && stl.displacement < 1e-6);

  const patches = await client.meshes.patches(a.id);
  assert.equal(patches.patch_count, patches.patches.length);
  assert.equal(patches.patches.reduce((sum, patch) => sum + patch.faces.length, 0), 4800);

  await client.meshes.delete(back.mesh.id);
  await assert.rejects(client.meshes.get(back.mesh.id), { code: "mesh_not_found", status: 404 });
});

test("meshes have notes and a quality", async () => {
  const noted = await client.meshes.create(off(sphere()), { name: "noted", unit: "mm", uncertainty: 0.25, labels: ["js", "a-b"] });
  assert.deepEqual([noted.mesh.unit, noted.mesh.uncertainty, noted.mesh.labels], ["mm", 0.25, ["js", "a-b"]]);
  assert.deepEqual((await collect(client.meshes.list({ label: "js" }))).map((mesh) => mesh.id), [noted.mesh.id]);
  const changed = await client.meshes.change(noted.mesh.id, { unit: null, labels: [] });
  assert.deepEqual([changed.unit, changed.uncertainty, changed.labels], [null, 0.25, []]);

  const { metrics } = await client.meshes.quality(noted.mesh.id);
  assert.equal(metrics.length, 10);
  const skew = await client.meshes.qualityOfFaces(noted.mesh.id, "skew");
  assert.equal(skew.values.length, 4800);
  assert.equal(skew.maximum, skew.values[skew.maximum_face ?? 0]);
  await client.meshes.delete(noted.mesh.id);
});

test("nearest points come as rows, of float64 and float32 alike", async () => {
  for (const points of [new Float64Array([0, 0, 3, 2, 0, 0]), new Float32Array([0, 0, 3, 2, 0, 0])]) {
    const rows = (await collect(client.meshes.project(a.id, points))).flatMap((block) => [...block]);
    assert.equal(rows.length, 2 * FOOT_WIDTH);
    assert(Math.abs(rows[0] - Math.hypot(3 - Math.cos(Math.PI / 50), Math.sin(Math.PI / 50))) < 1e-2);
    assert(Math.abs(rows[FOOT_WIDTH] - 1) < 1e-3);
  }
});

test("a job: events to the end, the result, the list", async () => {
  const job = await client.jobs.create({ type: "hausdorff", a: a.id, b: b.id });
  const events = await collect(client.jobs.events(job.id));
  checkBounds(events);
  assert.deepEqual(events.map((event) => event.seq), events.map((_, place) => place + 1));
  const last = events.at(-1);
  assert.equal(last.event, "result");
  assert(last.result.lower <= SPHERE_DISTANCE + 1e-7 && last.result.upper >= SPHERE_DISTANCE - 1e-7);
  const ended = await client.jobs.get(job.id, { wait: 10 });
  assert.equal(ended.state, "succeeded");
  assert.deepEqual(ended.result, last.result);
  assert.deepEqual(await client.jobs.result(job.id), last.result);
  assert((await collect(client.jobs.list())).some((listed) => listed.id === job.id));

  const later = await collect(client.jobs.events(job.id, { after: events.length - 1 }));
  assert.deepEqual(later, [last]);
  const streamed = await collect(client.jobs.stream({ type: "hausdorff", a: a.id, b: b.id, direction: "a_to_b" }));
  assert.equal(streamed.at(-1).event, "result");
  const again = await client.jobs.create({ type: "hausdorff", a: a.id, b: b.id }, { wait: 10 });
  assert.equal(again.cached, true);
  const fresh = await client.jobs.create({ type: "hausdorff", a: a.id, b: b.id }, { wait: 30, fresh: true });
  assert.notEqual(fresh.id, job.id);
  const [once, twice] = await Promise.all([1, 2].map(() => client.jobs.create(
    { type: "project", mesh: a.id, points: [[0, 0, 3]] }, { idempotencyKey: "k", wait: 10 })));
  assert.equal(once.id, twice.id);
  assert.equal(once.result.points.length, 1);
});

test("a deviation has a distance for each vertex", async () => {
  const job = await client.jobs.create({ type: "deviation", a: a.id, b: b.id, pieces: 5000 }, { wait: 60 });
  const distances = await client.jobs.distances(job.id);
  assert.equal(distances.length, a.vertices);
  assert(Math.max(...distances) <= job.result.max.upper);
});

test("a batch answers every line", async () => {
  const answers = await collect(client.jobs.batch([
    { key: "one", type: "project", mesh: a.id, points: [[0, 0, 3]] },
    { key: 2, type: "hausdorff", a: a.id, b: "m_none" },
  ]));
  assert.deepEqual(new Set(answers.map((answer) => answer.key)), new Set(["one", 2]));
  assert.equal(answers.find((answer) => answer.key === "one").state, "succeeded");
  assert.equal(answers.find((answer) => answer.key === 2).problem.code, "mesh_not_found");
});

test("a job can be canceled, and a subscriber can leave", async () => {
  const job = await slowJob(client);
  const left = new AbortController();
  await assert.rejects(async () => {
    for await (const event of client.jobs.events(job.id, { signal: left.signal })) {
      assert.equal(event.event, "bounds");
      left.abort();
    }
  }, { name: "AbortError" });
  await client.jobs.cancel(job.id);
  const events = await collect(client.jobs.events(job.id));
  assert.equal(events.at(-1).state, "canceled");
  checkBounds(events);
  await assert.rejects(client.jobs.cancel(job.id), { status: 409 });
});

test("moved vertices make a revision; collisions and least distances follow", async () => {
  const one = (await client.meshes.create(off(box(4)), { name: "one.off" })).mesh;
  const two = (await client.meshes.create(off(moved(box(4), [2, 0, 0])), { name: "two.off" })).mesh;
  const pair = { a: one.id, b: two.id };
  const apart = await client.jobs.create({ type: "distance", ...pair }, { wait: 30 });
  assert(apart.result.lower <= 1 && apart.result.upper >= 1 && apart.result.lower > 0.999999);
  const { revision } = await client.meshes.deform(two.id, Float64Array.from(moved(box(4), [0.75, 0, 0]).vertices.flat()));
  assert.equal(revision, 1);
  const found = await client.jobs.create({ type: "collision", ...pair }, { wait: 30 });
  assert(found.result.collides);
  const pairs = await client.jobs.pairs(found.id);
  assert.equal(pairs.length, 2 * found.result.count);
  assert.deepEqual([...pairs.slice(0, 2)], found.result.pairs[0].faces);

  const before = await client.jobs.create({ type: "self_collision", mesh: one.id }, { wait: 30 });
  assert.equal(before.result.count, 0);
  const corner = box(4).vertices.findIndex((point) => point.every((x) => x === 0));
  await client.meshes.deform(one.id, { indices: [corner], positions: [[2, 2, 2]] }, { ifMatch: "*" });
  const after = await client.jobs.create({ type: "self_collision", mesh: one.id, incremental: true }, { wait: 30 });
  assert(after.result.incremental && after.result.count > 0);
});

test("all pairs of a set, and two files of which nothing is kept", async () => {
  const meshes = [];
  for (const x of [0, 1, 3]) {
    meshes.push((await client.meshes.create(off(moved(box(2), [x, 0, 0])), { name: "moved.off" })).mesh.id);
  }
  const { id, result } = await client.jobs.create({ type: "matrix", meshes, want: { nearest: 1 } }, { wait: 30 });
  assert.deepEqual(result.nearest.map(([first]) => first.mesh), [1, 0, 1]);
  const rows = await client.jobs.pairs(id);
  assert.equal(rows.length, 12);
  assert(rows[2] <= 1 && rows[3] >= 1 && rows[6] <= 3 && rows[7] >= 3);
  const before = (await collect(client.meshes.list())).length;
  const files = [0, 1].map((x) => new Blob([off(moved(box(2), [x, 0.5, 0]))]));
  const answer = await client.jobs.compare(files[0], files[1], { quads: "bilinear" });
  const { lower, upper } = answer.symmetric.hausdorff;
  assert(lower <= 1 && upper >= 1 && answer.quads === "bilinear");
  assert.equal((await collect(client.meshes.list())).length, before);
  await assert.rejects(client.jobs.compare(files[0], new Blob(["no mesh"])), (error) => error instanceof ProblemError);
});

test("a layout is edited, undone, and grows into quads", async () => {
  const { mesh } = await client.meshes.create(off(ball(24)), { name: "ball.off" });
  const layout = await client.layouts.create({ mesh: mesh.id, ...ballLayout() });
  assert(layout.complete && layout.patches.length === 6, JSON.stringify(layout.issues));
  const cut = await client.layouts.split(layout.id, 0, layout.curves[0].points[4]);
  assert.equal(cut.curves.length, 13);
  assert(!cut.complete && cut.issues.length > 0);
  const [first, second] = [...cut.changed.changed_curves, ...cut.changed.added_curves];
  assert.equal((await client.layouts.merge(layout.id, first, second)).curves.length, 12);
  assert.equal((await client.layouts.undo(layout.id)).curves.length, 13);
  assert.equal((await client.layouts.redo(layout.id)).curves.length, 12);
  assert.equal((await client.layouts.deleteCurve(layout.id, first)).curves.length, 11);
  await client.layouts.undo(layout.id);
  const redrawn = await client.layouts.redraw(layout.id, first, ballLayout(4).curves[0].points);
  assert.equal(redrawn.curves.find((curve) => curve.id === first).points.length, 5);
  assert((await collect(client.layouts.list())).some((listed) => listed.id === layout.id));

  const grown = await client.reconstructions.create({ layout: layout.id });
  assert.equal(grown.quads, 6);
  const job = await client.jobs.create({ type: "reconstruction_step", reconstruction: grown.id, steps: 2 });
  const events = await collect(client.jobs.events(job.id));
  assert.deepEqual(events.map((event) => event.event), ["step", "step", "result"]);
  const now = await client.reconstructions.get(grown.id);
  assert.equal(now.quads, events.at(-1).result.quads);
  assert((await collect(client.reconstructions.list())).length === 1);
  assert.equal((await client.reconstructions.patches(grown.id)).patches.length, 6);
  assert.match(new TextDecoder().decode(await client.reconstructions.mesh(grown.id, { format: "off" })), /^OFF/);
  const edited = await client.layouts.redraw(layout.id, first, ballLayout(4).curves[0].points.map(([x, y, z]) => [x, 1.01 * y, z]));
  const taken = await client.reconstructions.takeLayout(grown.id, edited.id);
  assert.deepEqual([taken.redone_patches, taken.quads], [2, now.quads]);
  await client.reconstructions.delete(grown.id);
  await client.layouts.delete(layout.id);
  await assert.rejects(client.layouts.get(layout.id), { status: 404 });
});

test("curves along the normal of the surface are returned as they are", async () => {
  // At a corner of a box one of the three edges may have no direction in the plane of the surface.
  const { mesh } = await client.meshes.create(off(box(8)), { name: "box.off" });
  const layout = await client.layouts.create({ mesh: mesh.id, ...boxLayout() });
  assert.equal(layout.complete, layout.issues.length === 0);
  await client.layouts.delete(layout.id);
});

test("a stroke in the window becomes a curve", async () => {
  const { mesh } = await client.meshes.create(off(box(8)), { name: "box.off" });
  const layout = await client.layouts.create({ mesh: mesh.id });
  // Seen from above without perspective: x and y from -1 to 2 fill the window.
  const view = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -0.5, -0.5, -5, 1];
  const projection = [2 / 3, 0, 0, 0, 0, 2 / 3, 0, 0, 0, 0, -0.2, 0, 0, 0, -1, 1];
  const edited = await client.layouts.stroke(layout.id, {
    points: [[110, 150], [150, 150], [190, 150]], view, projection, viewport: [0, 0, 300, 300], snap: 0.02 });
  assert.equal(edited.curves.length, 1);
  assert(edited.curves[0].points.every(([, y, z]) => Math.abs(y - 0.5) < 1e-9 && z === 1), JSON.stringify(edited.curves));
  assert.equal(edited.stroke.missed_points, 0);
  assert.equal(edited.issues.filter((issue) => issue.kind === "dangling_end").length, 2);
});

test("tools edit layouts from outside the client", async () => {
  const { mesh } = await client.meshes.create(off(roundedBox(10)), { name: "tools.off" });
  const tools = new LayoutTools(client.layouts);
  const { id } = await client.layouts.create({ mesh: mesh.id });
  // Without perspective, along z; a stroke down the middle, and one beside it.
  const view = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -5, 1];
  const projection = [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, -0.2, 0, 0, 0, -1, 1];
  const down = (x) => ({ points: [[x, 120], [x, 150], [x, 180]], view, projection, viewport: [0, 0, 300, 300] });
  const first = (await tools.ring(id, down(180))).stroke.curve;
  const second = (await tools.ring(id, down(120))).stroke.curve;
  let now = await tools.tube(id, first, second);
  assert.deepEqual([now.curves.length, now.patches.length, now.complete], [12, 6, true]);
  now = await tools.splitChord(id, now.changed.added_curves[0], { parts: 3 });
  assert(now.complete && now.patches.length === 14, `${now.patches.length} ${JSON.stringify(now.issues)}`);
  const [node, other] = [now.curves[0].from, now.curves[0].to];
  now = await tools.moveNode(id, node, { point: now.nodes[node].map((value) => value * 0.98) });
  assert(now.changed.changed_curves.length >= 3);
  const { points } = now.curves[0];
  now = await tools.slide(id, now.curves[0].id, { from: points[Math.floor(points.length / 2)], to: points[Math.floor(points.length / 2)].map((value, k) => (k === 0 ? value + 0.1 : value)) });
  assert.deepEqual(now.changed.changed_curves, [now.curves[0].id]);
  now = await tools.mergeNodes(id, node, other);
  assert(!now.complete);
  now = await tools.link(id, 0, now.nodes.length - 1);
  assert.equal(now.changed.added_curves.length, 1);
  for (let k = 0; k < 2; k++) await client.layouts.undo(id);
  now = await tools.mirror(id, { point: [0, 0, 0], normal: [1, 0, 0] });
  assert(now.complete, JSON.stringify(now.issues));
  // A curve less makes one cell of six sides of two patches; a fill divides it again.
  const shared = now.curves.find(({ id: curve }) => now.patches.filter((sides) => sides.includes(curve)).length === 2);
  now = await client.layouts.deleteCurve(id, shared.id);
  assert(!now.complete);
  now = await tools.fill(id);
  assert(now.filled_cells === 1 && now.complete, JSON.stringify(now.issues));
});

test("refusals name their location", async () => {
  await assert.rejects(client.meshes.create("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", { format: "obj" }), (error) => {
    assert(error instanceof ProblemError);
    assert.deepEqual([error.status, error.code, error.places[0].line], [422, "index_out_of_range", 4]);
    assert.match(error.message, /vertex 4/);
    return true;
  });
  await assert.rejects(client.jobs.create({ type: "hausdorff", a: a.id, b: b.id, tolerance: -1 }),
    (error) => error.places[0].pointer === "/tolerance");
  const unreachable = new Client({ base: "http://127.0.0.1:1" });
  await assert.rejects(unreachable.system.info(), (error) => error instanceof ConnectionError);
});

test("the system's calls", async () => {
  const info = await client.system.info();
  assert.equal(info.name, "quadmeshd");
  assert.equal((await client.system.health()).status, "ok");
  assert.equal((await client.system.ready()).status, "ready");
  assert.match(await client.system.metrics(), /^# /m);
  assert.match(await client.system.description(), /^openapi: 3\.1/);
});

test("a stream goes on over restarts of the daemon", async () => {
  const own = await Daemon.start();
  try {
    const job = await slowJob(own.client());
    let breaks = 0;
    let events = 0;
    let terminal;
    for await (const event of own.client().jobs.events(job.id, { onBreak: () => { breaks += 1; } })) {
      events += 1;
      if (event.event !== "bounds") terminal = event;
      if (events === 2) {
        await own.stop("SIGKILL");
        await own.start();
      } else if (breaks > 0 && !terminal) {
        await own.client().jobs.cancel(job.id).catch((error) => assert.equal(error.status, 409));
      }
    }
    assert(breaks > 0);
    assert.equal(terminal.state, "canceled");
  } finally {
    await own.remove();
  }
});

test("a token opens a daemon that wants one", async () => {
  const token = "w".repeat(20);
  const file = path.join(daemon.folder, "tokens");
  writeFileSync(file, `write ${token}\n`, { mode: 0o600 });
  const own = await Daemon.start("--token-file", file);
  try {
    const guest = own.client();
    await assert.rejects(guest.system.info(), { code: "unauthorized" });
    guest.token = token;
    assert.equal((await guest.system.info()).name, "quadmeshd");
    await until(async () => (await guest.system.ready()).status === "ready", "readiness");
  } finally {
    await own.remove();
  }
});
