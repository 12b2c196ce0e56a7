// Flights to a place end where it is seen: a ray from the eye meets it before anything else. What is hidden is drawn hollow.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, fly, viewOf, waitForView } from "./support/page.js";
import { box, moved, off, well } from "./support/shapes.js";

let daemon;
let browser;
const ids = {};
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  const small = ({ vertices, faces }) => ({ faces, vertices: vertices.map((point) => point.map((x) => 0.1 * x)) });
  const shell = (gap) => ({ faces: box(1).faces, vertices: box(1).vertices.map((point) => point.map((x) => gap + (1 - 2 * gap) * x)) });
  const together = (...parts) => parts.reduce((all, { vertices, faces }) => ({
    vertices: [...all.vertices, ...vertices], faces: [...all.faces, ...faces.map((face) => face.map((vertex) => vertex + all.vertices.length))] }));
  const meshes = {
    well: well(0.2), deeper: well(0.1), pebble: moved(small(box(1)), [0.43, 0.44, 0.15]),
    longer: { ...box(4), vertices: box(4).vertices.map(([x, y, z]) => [x, y, z === 0 ? -0.3 : z]) }, closed: box(4), layers: together(shell(0), shell(0.001), shell(0.002)), skins: together(shell(0), shell(0.002)),
  };
  for (const [name, mesh] of Object.entries(meshes)) ids[name] = (await daemon.client().meshes.create(off(mesh), { name })).mesh.id;
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

/** How far along the way from the eye to a point of the meshes the first surface is met that hides what is behind it: 1 at the point. */
const metAt = (page, point) => page.evaluate(async (target) => {
  const { currentStage } = await import("/dashboard/view/view.js");
  const stage = currentStage();
  const place = stage.toScene(target).project(stage.eye.camera);
  const { pick } = await import("/dashboard/view/pick.js");
  const { clientWidth: width, clientHeight: height } = stage.canvas;
  let nearest = Infinity;
  for (const model of stage.opaqueModels()) {
    const hit = pick(stage, model, ((place.x + 1) / 2) * width, ((1 - place.y) / 2) * height);
    if (hit) nearest = Math.min(nearest, stage.toScene(hit.point).distanceTo(stage.eye.camera.position));
  }
  return nearest / stage.toScene(target).distanceTo(stage.eye.camera.position);
}, point);

/** A page with the farthest points of two meshes in its view. */
async function showFarthest(a, b) {
  const page = await browser.open(`${daemon.url}/#compare?a=${a}&b=${b}`);
  await waitForView(page);
  await fly(page, () => page.getByRole("button", { name: "Measure" }).click());
  await page.locator("#outcome", { hasText: "Done" }).waitFor();
  await fly(page, () => page.getByRole("button", { name: "Show the farthest points" }).click());
  return page;
}

test("the farthest points at the bottom of a well are seen from its mouth, not through its foot", async () => {
  const page = await showFarthest(ids.well, ids.deeper);
  const hash = new URLSearchParams(new URL(page.url()).hash.split("?")[1]);
  const { result } = await daemon.client().jobs.get(hash.get("job"));
  const onA = result.witness.from.mesh === "a" ? result.witness.from.point : result.witness.to.point;
  const met = await metAt(page, onA);
  assert(met > 0.995 && met < 1.005, `the first surface is met at ${met} of the way to ${onA}`);
  await finish(page);
});

test("a place at the back of a closed surface is seen from outside, not from within", async () => {
  const page = await showFarthest(ids.closed, ids.longer);
  const height = await page.evaluate(async () => {
    const { eye, frame } = (await import("/dashboard/view/view.js")).currentStage();
    return eye.camera.position.z / frame.scale + frame.centre[2];
  });
  assert(height < -0.3, `the eye is at z = ${height}`);
  await finish(page);
});

test("a flight that begins during another one takes its place, and arrives", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.closed}&b=${ids.longer}`);
  await waitForView(page);
  await page.evaluate(async () => {
    const { eye } = (await import("/dashboard/view/view.js")).currentStage();
    const at = (x) => eye.controls.target.clone().set(x, 0, 0);
    eye.flyTo(at(0.2), 1);
    await new Promise((resolve) => { setTimeout(resolve, 200); });
    eye.flyTo(at(-0.2), 1);
  });
  await page.waitForFunction((view) => view.currentStage().eye.flight === 0, await viewOf(page));
  const x = await page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.controls.target.x);
  assert(Math.abs(x + 0.2) < 1e-6, `${x}`);
  await finish(page);
});

test("a contact within a well is seen", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.well}&b=${ids.pebble}`);
  await waitForView(page);
  await fly(page, () => page.getByRole("button", { name: "Find collisions" }).click());
  await page.waitForFunction(() => document.querySelector("#contact")?.textContent.startsWith("1 of"));
  const { result } = await daemon.client().jobs.create({ type: "collision", a: ids.well, b: ids.pebble, quads: "triangles", limit: 10000 }, { wait: 30 });
  const [{ points }] = result.pairs;
  const met = await metAt(page, points[0]);
  assert(met > 0.99, `the first surface is met at ${met} of the way to ${points[0]}`);
  await finish(page);
});

test("an issue of a layout within a well is seen", async () => {
  const line = [0.35, 0.45, 0.55, 0.65].map((x) => [x, 0.5, 0.2]);
  const layout = await daemon.client().layouts.create({ mesh: ids.well, nodes: [line[0], line[3]], curves: [{ id: 0, from: 0, to: 1, points: line }] });
  const page = await browser.open(`${daemon.url}/#sketch?a=${ids.well}&layout=${layout.id}`);
  await waitForView(page);
  await fly(page, () => page.locator(".issues button").first().click());
  const met = await metAt(page, layout.issues[0].point);
  assert(met > 0.995, `the first surface is met at ${met} of the way`);
  await finish(page);
});

test("a place that no side shows makes the surfaces see-through, and the page says so", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.layers}&b=${ids.skins}`);
  await waitForView(page);
  const through = page.locator(".stage-tools").getByRole("button", { name: "See through" });
  assert.equal(await through.getAttribute("aria-pressed"), "false");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.locator(".message", { hasText: "see-through" }).waitFor();
  assert.equal(await through.getAttribute("aria-pressed"), "true");
  await through.click();
  assert.equal(await through.getAttribute("aria-pressed"), "false");
  await finish(page);
});

test("the ends of a pair are hollow where a surface hides them", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.closed}`);
  await waitForView(page);
  /** Is the middle of the mark in its own colour, and is there a mark at all? */
  const markAt = (point) => page.evaluate(async (at) => {
    const { currentStage } = await import("/dashboard/view/view.js");
    const stage = currentStage();
    stage.eye.fromText("0,0,1.6,0,0,0");
    stage.setPair({ from: at, to: [at[0] + 0.3, at[1], at[2]] });
    stage.drawNow();
    const on = stage.toScene(at).project(stage.eye.camera);
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [stage.canvas.width, stage.canvas.height];
    const context = copy.getContext("2d", { willReadFrequently: true });
    context.drawImage(stage.canvas, 0, 0);
    const [x, y] = [((on.x + 1) / 2) * copy.width, ((1 - on.y) / 2) * copy.height];
    const isMark = (dx) => { const [r, , b] = context.getImageData(Math.round(x + dx), Math.round(y), 1, 1).data; return r > 1.5 * b; };
    const left = [-6, -5, -4, -3].some(isMark);
    return { middle: isMark(-1), rim: left };
  }, point);
  assert.deepEqual(await markAt([0.5, 0.5, 1.2]), { middle: true, rim: true }); // in front of the box
  assert.deepEqual(await markAt([0.5, 0.5, 0.2]), { middle: false, rim: true }); // within it
  await finish(page);
});
