// Sketching layouts by strokes of mouse, pen and finger, and growing one into quads.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";

import { BUILD, Daemon } from "./support/daemon.js";
import { Browser, finish, viewOf, waitForView } from "./support/page.js";
import { draw, lookAt, waitForPen } from "./support/strokes.js";
import { off, roundedBox, roundedBoxLayout } from "./support/shapes.js";

let daemon;
let browser;
let mesh;
const { nodes, curves } = roundedBoxLayout();
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ({ mesh } = await daemon.client().meshes.create(off(roundedBox()), { name: "box.off" }));
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const says = (page, words) => page.locator("#sketch", { hasText: words }).waitFor();
const did = (page, words) => page.locator("#sketch-words", { hasText: words }).waitFor();

/** How many colours other than the surface's own the view has: tints of patches. */
const shadedShare = (page) => page.evaluate(async () => {
  const { currentStage } = await import("/dashboard/view/view.js");
  return [...currentStage().models.get("a").regions?.image.data ?? []].filter((value, place) => place % 4 === 3 && value > 0).length;
});

async function open(layout, id = mesh.id) {
  const page = await browser.open(`${daemon.url}/#sketch?a=${id}${layout ? `&layout=${layout}` : ""}`);
  await waitForPen(page);
  return page;
}

test("features are drawn by a button, and curves and nodes are marked by clicks", async () => {
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [(k & 1) * 2 - 1, (k & 2) - 1, (k >> 1 & 2) - 1]);
  const sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
  const faces = sides.flatMap(([a, b, c, d]) => [[a, b, c], [a, c, d]]);
  const { mesh: cube } = await daemon.client().meshes.create(off({ vertices: corners, faces }), { name: "cube.off" });
  const page = await open(undefined, cube.id);
  await page.getByRole("button", { name: "Features" }).click();
  await did(page, "12 curves run along features.");
  await says(page, "6 patches");
  const id = new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("layout");
  const layouts = daemon.client().layouts;
  const drawn = await layouts.get(id);
  assert(drawn.curves.every(({ mark }) => mark === "sharp") && drawn.corners.length === 8);
  await page.getByRole("button", { name: "Features" }).click();
  await did(page, "no features that are not drawn");

  await page.getByRole("button", { name: "Mark", exact: true }).click();
  const [onEdge, atCorner] = await lookAt(page, [2, 1.5, 1], [[1, 1, 0], [1, 1, 1]]);
  const edge = drawn.curves.find(({ points }) => points.every(([x, y]) => x === 1 && y === 1)).id;
  for (const mark of ["fixed", "smooth", "sharp"]) {
    await page.mouse.click(...onEdge);
    await did(page, `Curve ${edge} is ${mark} now.`);
    assert.equal((await layouts.get(id)).curves.find((curve) => curve.id === edge).mark ?? "smooth", mark);
  }
  const node = drawn.nodes.findIndex((place) => place.every((value) => value === 1));
  await page.mouse.click(...atCorner);
  await did(page, `Node ${node} is no corner now.`);
  await page.getByRole("button", { name: "Undo" }).click();
  await did(page, "Undone.");
  assert.equal((await layouts.get(id)).corners.length, 8);

  // A stroke beside a crease comes onto it, and with Alt stays where it was drawn.
  const { mesh: other } = await daemon.client().meshes.create(off({ vertices: corners, faces }), { name: "another cube.off" });
  const empty = await layouts.create({ mesh: other.id });
  await finish(page);
  const second = await open(empty.id, other.id);
  const beside = [-0.5, -0.2, 0.2, 0.5].map((z) => [1, 0.98, z]);
  await draw(second, await lookAt(second, [2, 1.5, 1], beside));
  await did(second, "is new");
  const [snapped] = (await layouts.get(empty.id)).curves;
  assert(snapped.mark === "sharp" && snapped.points.every(([x, y]) => x === 1 && y === 1));
  await second.getByRole("button", { name: "Undo" }).click();
  await did(second, "Undone.");
  await second.keyboard.down("Alt");
  await draw(second, await lookAt(second, [2, 1.5, 1], beside));
  await second.keyboard.up("Alt");
  await did(second, "is new");
  assert((await layouts.get(empty.id)).curves.every(({ mark, points }) => mark === undefined && points.every(([, y]) => y < 0.999)));
  await finish(second);
});

test("suggested curves are taken by clicks", async () => {
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [(k & 1) * 2 - 1, (k & 2) - 1, (k >> 1 & 2) - 1]);
  const sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
  const faces = sides.flatMap(([a, b, c, d]) => [[a, b, c], [a, c, d]]);
  const { mesh: cube } = await daemon.client().meshes.create(off({ vertices: corners, faces }), { name: "suggested cube.off" });
  const empty = await daemon.client().layouts.create({ mesh: cube.id });
  const page = await open(empty.id, cube.id);
  await page.getByRole("button", { name: "Suggest curves" }).click();
  await did(page, "12 suggested");
  const list = page.getByRole("list", { name: "Suggested curves" }).getByRole("button");
  for (let left = 12; left > 0; left--) {
    assert.equal(await list.count(), left);
    await list.first().click();
    await did(page, left > 1 ? `${left - 1} suggested` : "There is nothing to suggest.");
  }
  await says(page, "6 patches");
  assert((await daemon.client().layouts.get(empty.id)).complete);

  await page.locator("select[name=mirror]").selectOption("found");
  await did(page, "The mirror image at the plane is at most");
  await page.getByRole("button", { name: "Mirror", exact: true }).click();
  await did(page, "One side is the image of the other now.");
  await finish(page);
});

test("a layout of the whole surface is made by a button, and grown into quads", async () => {
  const { mesh: own } = await daemon.client().meshes.create(off(roundedBox(12)), { name: "whole box.off" });
  const page = await open(undefined, own.id);
  await page.locator("input[name=quad_count]").fill("600");
  await page.getByRole("button", { name: "Make a layout" }).click();
  await says(page, "every cell is closed");
  const id = new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("layout");
  const layout = await daemon.client().layouts.get(id);
  assert(layout.complete && layout.patches.length >= 6);
  await says(page, `${layout.patches.length} patches`);
  while (await shadedShare(page) === 0) await new Promise((done) => { setTimeout(done, 50); });
  await page.getByRole("link", { name: "Remesh this layout" }).click();
  await page.getByRole("button", { name: "Start from the layout" }).click();
  await page.locator("#remesh", { hasText: "One quad a patch" }).waitFor();
  await finish(page);

  const { mesh: cloud } = await daemon.client().meshes.create("0 0 0\n1 0 0\n0 1 0\n0 0 1\n", { name: "cloud.xyz" });
  const other = await browser.open(`${daemon.url}/#sketch?a=${cloud.id}`);
  await waitForPen(other);
  await other.getByRole("button", { name: "Make a layout" }).click();
  await other.locator(".is-fault", { hasText: "too few for a surface" }).waitFor();
  await finish(other);
});

test("a curve is drawn by keyboard alone", async () => {
  const { mesh: own } = await daemon.client().meshes.create(off(roundedBox(12)), { name: "another box.off" });
  const page = await open(undefined, own.id);
  const side = () => page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.side.toArray().join());
  await page.locator(".canvas canvas").focus();
  const before = await side();
  await page.keyboard.press("d");
  await page.locator(".key-pen").waitFor();
  for (let n = 0; n < 3; n++) await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("d");
  await page.locator(".key-pen.is-down").waitFor();
  for (let n = 0; n < 6; n++) await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Escape"); // it was another one
  await page.locator(".key-pen").waitFor({ state: "hidden" });
  for (const key of ["d", "ArrowLeft", "ArrowLeft", "d", ...Array(7).fill("ArrowRight"), "Shift+ArrowDown", "d"]) await page.keyboard.press(key);
  await says(page, "1 curve");
  assert.equal(await side(), before, "the arrows led the pen");
  const layout = new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("layout");
  const { curves: [{ points }] } = await daemon.client().layouts.get(layout);
  const [from, to] = await page.evaluate(async (ends) => {
    const { toWindow } = await import("/dashboard/sketch/window.js");
    const stage = (await import("/dashboard/view/view.js")).currentStage();
    return ends.map((end) => toWindow(stage, end));
  }, [points[0], points.at(-1)]);
  assert(Math.abs(to[0] - from[0] - 7 * 12) < 4 && Math.abs(to[1] - from[1] - 3) < 3, `${from} ${to}`);
  await page.keyboard.press("ArrowRight");
  assert.notEqual(await side(), before);
  await finish(page);
  await daemon.client().layouts.delete(layout); // others look for the only one
});

test("a whole layout is drawn, undone and done again, and grown into a thousand quads", async () => {
  const page = await open();
  await says(page, "Nothing is drawn yet");
  for (const [place, { points }] of curves.entries()) {
    await draw(page, await lookAt(page, points[4], points));
    await says(page, `${place + 1} curve`);
    if (place === 0) assert.equal(await page.locator(".issues li").count(), 2); // both ends hang free
  }
  await says(page, "12 curves, 6 patches; every cell is closed");
  assert.equal(await page.locator(".issues li").count(), 0);
  await page.waitForFunction((view) => view.currentStage().models.get("a").regions, await viewOf(page));
  assert(await shadedShare(page) > 10000);
  await page.keyboard.press("Control+z");
  await says(page, "11 curves");
  await page.keyboard.press("Control+Shift+z");
  await says(page, "12 curves, 6 patches; every cell is closed");
  await page.reload();
  await says(page, "12 curves, 6 patches; every cell is closed");

  await page.getByRole("link", { name: "Remesh this layout" }).click();
  await page.getByRole("button", { name: "Start from the layout" }).click();
  await page.locator("#remesh", { hasText: "One quad a patch" }).waitFor();
  await page.getByRole("button", { name: "One step" }).click();
  await page.locator("#remesh", { hasText: "Refined" }).waitFor();
  assert.equal(await page.locator("tbody tr").count(), 1);
  await page.getByRole("button", { name: "Run to the goal" }).click();
  await page.locator("#remesh", { hasText: "more than 1,000 quads" }).waitFor();
  const quads = Number((await page.locator(".figures dd").first().innerText()).replace(",", ""));
  assert(quads > 250 && quads <= 1000, String(quads));
  const [lower, upper] = (await page.locator("tbody tr td:nth-child(3)").first().innerText()).match(/[\d.]+(?= %)/g).map(Number);
  await page.getByRole("button", { name: "Map the error" }).click();
  await page.locator(".legend").waitFor();
  await page.locator("#remesh", { hasText: "from the quads in the mean" }).waitFor();

  await page.getByLabel("Format of the download").selectOption("off");
  const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Download" }).click()]);
  const grown = path.join(daemon.folder, "grown.off");
  const source = path.join(daemon.folder, "source.off");
  writeFileSync(grown, readFileSync(await file.path()));
  writeFileSync(source, off(roundedBox()));
  const { upper_relative: checked } = JSON.parse(execFileSync(path.join(BUILD, "quadmesh"), ["hausdorff", source, grown, "--json"], { encoding: "utf8" }));
  assert(100 * checked >= 0.995 * lower && 100 * checked <= 1.005 * upper, `${lower} ${upper} ${checked}`); // three digits

  // The layout is edited; only the two patches beside the curve are computed again.
  const layout = (await daemon.client().layouts.list({ mesh: mesh.id }).next()).value;
  const bent = curves[0].points.map(([x, y, z], k) => (k > 1 && k < 7 ? [x, y + 0.04, z + 0.04] : [x, y, z]));
  await daemon.client().layouts.redraw(layout.id, (await daemon.client().layouts.get(layout.id)).curves[0].id, bent);
  await page.getByRole("button", { name: "Take over edits" }).click();
  await page.locator("#remesh", { hasText: "2 of 6 patches computed again" }).waitFor();
  await finish(page);
});

test("what an end will snap to is shown; curves are chosen, split, merged, redrawn, moved and deleted", async () => {
  const layout = await daemon.client().layouts.create({ mesh: mesh.id, nodes, curves });
  const page = await open(layout.id);
  const [node, quarter, middle] = await lookAt(page, curves[0].points[4], [nodes[0], curves[0].points[2], curves[0].points[4]]);
  const snap = page.locator(".snap:not([hidden])");
  await page.mouse.move(node[0] + 3, node[1] + 2);
  await page.locator('.snap[data-kind="node"]:not([hidden])').waitFor();
  await page.mouse.move(quarter[0] + 2, quarter[1] + 2);
  await page.locator('.snap[data-kind="curve"]:not([hidden])').waitFor();
  await page.mouse.move(5 + (await page.locator(".canvas canvas").boundingBox()).x, node[1]);
  await snap.waitFor({ state: "detached" }).catch(() => {});
  assert.equal(await snap.count(), 0);

  await page.mouse.click(...middle);
  await page.getByRole("button", { name: "Split" }).click();
  await did(page, "cut in two");
  await says(page, "13 curves");
  assert.match(await page.locator(".issues").first().innerText(), /5 sides, not four/);
  // Both halves, and one again.
  await page.mouse.click(...quarter);
  const half = curves[0].points[6];
  await page.mouse.click(...(await lookAt(page, curves[0].points[4], [half]))[0]);
  await page.getByRole("button", { name: "Merge" }).click();
  await says(page, "12 curves, 6 patches; every cell is closed");

  await page.mouse.click(...middle);
  const before = (await daemon.client().layouts.get(layout.id)).curves[0].points;
  await page.getByRole("button", { name: "Redraw" }).click();
  const bent = curves[0].points.map(([x, y, z], k) => (k > 1 && k < 7 ? [x, y + 0.08, z + 0.08] : [x, y, z]));
  await draw(page, (await lookAt(page, curves[0].points[4], bent)).reverse());
  await did(page, "redrawn");
  await says(page, "12 curves, 6 patches; every cell is closed");
  assert.notDeepEqual((await daemon.client().layouts.get(layout.id)).curves[0].points, before);

  // The one curve that the list chooses; one of its ends is dragged onto another curve, and back by a key.
  await page.locator("select[name=curve]").selectOption("0");
  const [end, other] = await lookAt(page, nodes[0], [nodes[0], curves[1].points[3]]);
  await draw(page, [end, [(end[0] + other[0]) / 2, (end[1] + other[1]) / 2], other]);
  await did(page, "ends elsewhere");
  await says(page, "13 curves");
  await page.keyboard.press("Control+z");
  await says(page, "12 curves, 6 patches; every cell is closed");
  await page.locator("select[name=curve]").selectOption("3");
  await page.locator("h2").first().click();
  await page.keyboard.press("Delete");
  await says(page, "11 curves");
  await page.locator(".issues button").first().click(); // flies there
  await finish(page);
});

test("ends snap within some pixels, however near the eye is, and with Alt to nothing", async () => {
  const layout = await daemon.client().layouts.create({ mesh: mesh.id, nodes, curves });
  const page = await open(layout.id);
  const node = nodes[7];
  const zoomed = async (distance) => {
    const place = await page.evaluate(async ({ at, far }) => {
      const { currentStage } = await import("/dashboard/view/view.js");
      const { toWindow } = await import("/dashboard/sketch/window.js");
      const stage = currentStage();
      const scene = stage.toScene(at);
      stage.eye.controls.target.copy(scene);
      stage.eye.camera.position.copy(scene).addScaledVector(scene.clone().normalize(), far);
      stage.eye.controls.update();
      stage.drawNow();
      return toWindow(stage, at);
    }, { at: node, far: distance });
    const box = await page.locator(".canvas canvas").boundingBox();
    return [place[0] + box.x, place[1] + box.y];
  };
  const mark = page.locator('.snap[data-kind="node"]:not([hidden])');
  for (const distance of [1.4, 0.2]) {
    const [x, y] = await zoomed(distance);
    await page.mouse.move(x + 200, y + 150);
    await page.mouse.move(x + 6, y);
    await mark.waitFor();
    await page.mouse.move(x + 40, y + 40);
    await page.waitForTimeout(100);
    assert.equal(await mark.count(), 0, `at a distance of ${distance}`);
    await page.keyboard.down("Alt");
    await page.mouse.move(x + 5, y);
    await page.waitForTimeout(100);
    assert.equal(await mark.count(), 0);
    await page.keyboard.up("Alt");
  }
  await finish(page);
});

test("Space turns the view after a click on Undo, and undoes nothing; a deleted layout comes back", async () => {
  const layout = await daemon.client().layouts.create({ mesh: mesh.id, nodes, curves });
  await daemon.client().layouts.deleteCurve(layout.id, 3);
  await daemon.client().layouts.deleteCurve(layout.id, 7);
  const page = await open(layout.id);
  await says(page, "10 curves");
  await page.getByRole("button", { name: "Undo" }).click();
  await says(page, "11 curves");
  await page.keyboard.down("Space");
  assert.equal(await page.locator("canvas.draws").count(), 0); // the pen is put away
  await page.keyboard.up("Space");
  await did(page, "Undone");
  await page.waitForTimeout(300);
  await says(page, "11 curves");

  await page.getByRole("button", { name: "Delete layout" }).click();
  await page.locator("select[name=layout]").locator(`option[value="${layout.id}"]`).waitFor({ state: "detached" });
  await page.locator(".message", { hasText: "The layout is deleted" }).getByRole("button", { name: "Undo" }).click();
  await says(page, "11 curves");
  assert.equal((await daemon.client().layouts.get(layout.id)).curves.length, 11);
  assert.equal(await page.locator("select[name=layout]").inputValue(), layout.id);
  await finish(page);
});

test("fingers and pens draw as mice do; strokes that go on are joined, and cut what they meet", async () => {
  const page = await browser.open(`${daemon.url}/#sketch?a=${mesh.id}`, { hasTouch: true });
  await waitForPen(page);
  await page.locator("select[name=layout]").selectOption("");
  await says(page, "Nothing is drawn yet");
  const input = await page.context().newCDPSession(page);
  const touch = (type, ...fingers) => input.send("Input.dispatchTouchEvent", {
    type, touchPoints: fingers.map(([x, y], id) => ({ x, y, id })) });
  const across = (from, to, level) => Array.from({ length: 9 }, (_, i) => [from + ((to - from) * i) / 8, level, 1]);
  const place = (points) => lookAt(page, [0, 0, 1], points);

  const [start, ...rest] = await place(across(-0.5, 0, 0.1));
  await touch("touchStart", start);
  for (const point of rest) await touch("touchMove", point);
  await touch("touchEnd");
  await did(page, "is new");
  await says(page, "1 curve,");

  const pen = (type, [x, y], buttons) => input.send("Input.dispatchMouseEvent", { type, x, y, button: "left", buttons, pointerType: "pen", clickCount: 1 });
  const [first, ...more] = await place(across(0.01, 0.5, 0.1));
  await pen("mousePressed", first, 1);
  for (const point of more) await pen("mouseMoved", point, 1);
  await pen("mouseReleased", more.at(-1), 0);
  await did(page, "joined");
  await says(page, "1 curve,");

  await draw(page, await place([0.1, 0.2, 0.3, 0.4, 0.5].map((y) => [0.2, y, 1])));
  await did(page, "is cut where it meets it");
  await says(page, "3 curves");
  await draw(page, await place([-0.3, -0.1, 0.1, 0.3, 0.5].map((y) => [-0.2, y, 1]))); // straight across
  await did(page, "is cut where it meets it");
  await says(page, "6 curves");

  // Two fingers turn the view and draw nothing.
  const eye = () => page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.toText());
  const still = await eye();
  const [x, y] = start;
  await touch("touchStart", [x, y], [x + 60, y]);
  for (let step = 1; step <= 4; step++) await touch("touchMove", [x + 8 * step, y + 5 * step], [x + 60 + 8 * step, y + 5 * step]);
  await touch("touchEnd");
  assert.notEqual(await eye(), still);
  await says(page, "6 curves");
  await finish(page);
});

test("rings, tubes, rows, links, fills and mirrors are drawn by mouse, pen and finger; nodes and curves are dragged", async () => {
  const { mesh: own } = await daemon.client().meshes.create(off(roundedBox(10)), { name: "a box for tools.off" });
  const page = await browser.open(`${daemon.url}/#sketch?a=${own.id}`, { hasTouch: true });
  await waitForPen(page);
  const input = await page.context().newCDPSession(page);
  const touch = (type, ...fingers) => input.send("Input.dispatchTouchEvent", { type, touchPoints: fingers.map(([x, y], id) => ({ x, y, id })) });
  const tool = (name) => page.getByRole("group", { name: "A stroke" }).getByRole("button", { name, exact: true }).click();
  const place = (points) => lookAt(page, [0, 0, 1], points);
  const upright = (x, ys = [-0.4, -0.2, 0, 0.2, 0.4]) => ys.map((y) => [x, y, 1]);

  // A ring by the mouse, and one by a finger.
  await tool("Ring");
  await draw(page, await place(upright(0.3)));
  await did(page, "A ring is drawn; 4 curves are new.");
  await says(page, "4 curves, 2 patches; every cell is closed");
  const [start, ...rest] = await place(upright(-0.35));
  await touch("touchStart", start);
  for (const point of rest) await touch("touchMove", point);
  await touch("touchEnd");
  await says(page, "8 curves");
  await page.locator(".issues li", { hasText: "lie apart" }).waitFor();

  await tool("Draw");
  const [one, other] = await place([[0.3, 0.25, 1], [-0.35, 0.25, 1]]);
  await page.mouse.click(...one);
  await page.mouse.click(...other);
  await page.getByRole("button", { name: "Tube" }).click();
  await says(page, "12 curves, 6 patches; every cell is closed");

  // One row more, and back.
  await page.mouse.click(...one);
  await page.getByRole("button", { name: "Add row" }).click();
  await did(page, "is divided");
  await page.locator("#sketch", { hasText: "every cell is closed" }).waitFor();
  await page.keyboard.press("Control+z");
  await says(page, "12 curves, 6 patches");

  // A stroke across one patch ends inside its neighbours' sides: they have five, until they are filled.
  const sides = await daemon.client().layouts.get(new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("layout"));
  assert(sides.complete);
  await draw(page, await place([0.3, 0.15, 0, -0.15, -0.35].map((x) => [x, 0.25, 1])));
  await page.locator(".issues li", { hasText: "5 sides, not four" }).first().waitFor();
  await page.getByRole("button", { name: "Fill" }).click();
  await did(page, "2 cells are filled");
  await page.locator("#sketch", { hasText: "every cell is closed" }).waitFor();

  // A node and a curve by the pen.
  await tool("Move");
  const pen = (type, [x, y], buttons) => input.send("Input.dispatchMouseEvent", { type, x, y, button: "left", buttons, pointerType: "pen", clickCount: 1 });
  const drag = async (from, to) => {
    await pen("mousePressed", from, 1);
    for (const share of [0.3, 0.6, 1]) await pen("mouseMoved", from.map((value, k) => value + share * (to[k] - value)), 1);
    await pen("mouseReleased", to, 0);
  };
  const layoutOf = async () => daemon.client().layouts.get(sides.id);
  const node = (await layoutOf()).nodes.find(([x, y, z]) => z > 0.9 && x > 0 && Math.abs(y) < 0.1);
  await drag(...await place([node, [0.45, 0.05, 1]]));
  await did(page, "is moved");
  const curve = (await layoutOf()).curves.find(({ points }) => points.every(([x, y, z]) => z > 0.9 && Math.abs(y) < 0.12));
  const middle = curve.points[Math.floor(curve.points.length / 2)];
  await drag(...await place([middle, [middle[0], middle[1] - 0.12, 1]]));
  await did(page, `Curve ${curve.id} is bent`);
  await page.keyboard.press("Control+z");
  await page.keyboard.press("Control+z");
  await did(page, "Undone");

  // From node to node, which makes two cells of a patch.
  await tool("Link");
  const ends = (await layoutOf()).nodes.filter(([x, y, z]) => z > 0.9 && y < 0.3 && y > -0.3);
  const [low, high] = [ends.find(([x, y]) => x > 0 && y < 0.1), ends.find(([x, y]) => x < 0 && y > 0.1)];
  await drag(...await place([low, high]));
  await did(page, "are linked");
  await page.locator(".issues li", { hasText: "3 sides, not four" }).first().waitFor();
  await page.keyboard.press("Control+z");
  await did(page, "Undone");

  // Rings are mirrored as they are drawn; one side becomes the image of the other.
  await page.locator("select[name=layout]").selectOption("");
  await says(page, "Nothing is drawn yet");
  await page.locator("select[name=mirror]").selectOption("x");
  await tool("Ring");
  await draw(page, await place(upright(0.3)));
  await says(page, "8 curves");
  await page.getByRole("button", { name: "Mirror", exact: true }).click();
  await did(page, "image of the other");
  await says(page, "8 curves");

  // A node that is dragged takes its mirror image along, and what is deleted goes on both sides.
  await tool("Move");
  const now = async () => daemon.client().layouts.get(new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("layout"));
  const held = (await now()).nodes.find(([x, , z]) => z > 0.9 && x > 0);
  await drag(...await place([held, [held[0] + 0.12, held[1] + 0.1, 1]]));
  await did(page, "is moved");
  const [right, left] = [1, -1].map((side) => [side * (held[0] + 0.12), held[1] + 0.1, 1]);
  const { nodes } = await now();
  for (const wanted of [right, left]) assert(nodes.some((one) => Math.hypot(...one.map((value, k) => value - wanted[k])) < 0.03), `${wanted}`);
  await tool("Draw");
  const gone = (await now()).curves.find(({ points }) => points.every(([x]) => x > 0) && points[points.length >> 1][2] > 0.5);
  const [touched] = await place([gone.points[gone.points.length >> 1]]);
  await page.mouse.click(...touched);
  await page.keyboard.press("Delete");
  await says(page, "6 curves");
  await finish(page);
});
