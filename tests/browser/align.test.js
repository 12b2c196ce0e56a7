// The page's alignment: A is moved onto B by itself and by landmarks, in the view and in all questions; a copy is kept; links.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, waitForView } from "./support/page.js";
import { box, off } from "./support/shapes.js";

/** A box of which no two corners are alike, and a motion. */
const TURN = 0.9;
const SHIFT = [3, -2, 1];
const move = ([x, y, z]) => [Math.cos(TURN) * x - Math.sin(TURN) * y + SHIFT[0], Math.sin(TURN) * x + Math.cos(TURN) * y + SHIFT[1], z + SHIFT[2]];
function wedge(steps = 6) {
  const { vertices, faces } = box(steps);
  return { faces, vertices: vertices.map(([x, y, z]) => [x * (1 + 0.5 * z), 1.7 * y * (1 + 0.3 * x), 2.6 * z + 0.2 * x * y]) };
}
const BOUND = 1e-9;
/** A search for a distance of 0 ends at the gap, a share of 1e-6 of the diagonal. */
const GAP = 1e-5;

let daemon;
let browser;
let a;
let b;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  const still = wedge();
  const turned = { ...still, vertices: still.vertices.map(move) };
  [a, b] = await Promise.all([[turned, "turned.off"], [still, "still.off"]].map(async ([mesh, name]) => (await daemon.client().meshes.create(off(mesh), { name })).mesh.id));
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const open = (parameters = "") => browser.open(`${daemon.url}/#compare?a=${a}&b=${b}${parameters}`, { viewport: { width: 1300, height: 900 } });
const figure = (page, name) => page.locator("#alignment .figures > div", { hasText: name }).locator("dd").innerText();
const upper = (page) => page.locator("#upper .value").innerText().then(Number);
async function measure(page) {
  await page.getByRole("button", { name: "Measure", exact: true }).click();
  await page.locator("#outcome", { hasText: "Done" }).waitFor();
  return upper(page);
}

test("A is aligned onto B by a button; the view, the questions and a link have it where it is then", async () => {
  const page = await open();
  await waitForView(page);
  assert(await measure(page) > 1);
  await page.getByRole("button", { name: "Align A onto B" }).click();
  await page.locator("#alignment .figures").waitFor();
  assert(Number(await figure(page, "RMS of the distances")) < BOUND);
  assert.match(await figure(page, "No motion gets below"), /^0$|e-\d+$/);
  assert(Number(await figure(page, "RMS of the runner-up")) > 0.01);
  assert.equal(await page.locator("#upper .value").innerText(), "–", "what was measured before holds no more");
  await waitForView(page);
  const corner = await page.evaluate(async () => {
    const { models } = (await import("/dashboard/view/view.js")).currentStage();
    return [...models.get("a").box.min, ...models.get("a").frame.centre, ...models.get("b").frame.centre];
  });
  assert(Math.hypot(...corner.slice(3, 6).map((x, k) => x - corner[6 + k])) < 1, corner.join());
  assert(await measure(page) < GAP);
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator("#deviation").waitFor();
  assert.match(await page.locator("#deviation tr", { hasText: "Maximum" }).locator("td").innerText(), /^0$| e-([6-9]|\d\d)$/);
  await page.locator(".legend").waitFor();
  await page.waitForFunction(async () => { // the colours are those of A as it is moved
    const { heat, pieces } = (await import("/dashboard/view/view.js")).currentStage().models.get("a");
    const coloured = (heat.children.length > 0 ? heat.children : pieces).map(({ geometry }) => geometry.getAttribute("value"));
    const values = coloured.every(Boolean) ? coloured.flatMap(({ array }) => [...array].filter((_, place) => place % 2 === 0)) : [];
    return values.length > 0 && values.every((value) => Math.abs(value) < 1e-6);
  });

  const other = await browser.open(page.url());
  await other.locator("#outcome", { hasText: "Done" }).waitFor();
  assert(await upper(other) < GAP);
  await other.locator("#alignment .figures").waitFor(); // what the link names of it, once A is there
  await other.getByRole("button", { name: "Back to where A lies" }).click();
  assert(await measure(other) > 1);
  await finish(other);

  await page.getByRole("link", { name: "Jobs" }).click();
  const row = page.locator("tbody tr", { hasText: "turned.off, moved" }).first();
  await row.getByRole("link").click();
  await page.getByText("A is moved.").waitFor();
  await finish(page);
});

test("fit, motion, start, trim and mirror are the user's; floor and runner-up are told, and that no motion meets a limit", async () => {
  const { length } = await import("../../clients/dashboard/core/format.js");
  const coarse = wedge(2);
  const mirrored = { vertices: coarse.vertices.map(([x, y, z]) => [-x, 1.2 * y, z]), faces: coarse.faces.map((corners) => [...corners].reverse()) };
  const [other, fixed] = await Promise.all([mirrored, coarse].map(async (mesh, n) => (await daemon.client().meshes.create(off(mesh), { name: `coarse ${n}.off` })).mesh.id));
  const page = await browser.open(`${daemon.url}/#compare?a=${other}&b=${fixed}`);
  await waitForView(page);
  /** Aligns from where A lies by what is chosen, and compares what is shown with the daemon's answer. */
  async function align(choices, question) {
    const back = page.getByRole("button", { name: "Back to where A lies" });
    if (await back.isVisible()) await back.click();
    for (const [name, value] of Object.entries(choices)) {
      const field = page.locator(`[name=${name}]`);
      if (name === "mirror") await field.setChecked(value);
      else if (name === "trim") await field.fill(value);
      else await field.selectOption(value);
    }
    await page.getByRole("button", { name: "Align A onto B" }).click();
    await page.locator("#alignment .figures").waitFor();
    const { result } = await daemon.client().jobs.create({ type: "alignment", a: other, b: fixed, ...question }, { wait: 60 });
    assert.equal(await figure(page, "RMS of the distances"), length(result.rms, 4));
    const second = result.certainty.runner_up_rms;
    assert.equal(await figure(page, "RMS of the runner-up"), second === null ? "none: all starts ended here" : length(second, 4));
    assert.equal(await figure(page, "No motion gets below"), result.floor === null ? "not known with a scale" : length(result.floor, 4));
    assert.equal(await page.getByText("Mirror image", { exact: true }).count(), result.mirrored ? 1 : 0);
    return result;
  }
  const plain = await align({ start: "centroids" }, { start: "centroids" });
  const turned = await align({ start: "identity", mirror: true, trim: "20" }, { start: "identity", mirror: true, trim: 0.2 });
  assert(turned.rms < plain.rms);
  await align({ motion: "rigid_scale", mirror: false, trim: "0" }, { motion: "rigid_scale", start: "identity" });
  const best = await align({ fit: "min_max", motion: "rigid", start: "identity" }, { fit: "min_max", start: "identity" });
  assert(await page.locator("[name=trim]").isDisabled());
  assert(best.floor > 1e-3 && best.hausdorff.upper > 2 * best.floor);

  const limit = page.locator("input[name=limit]");
  for (const [value, words] of [[best.floor / 2, "No motion brings A within"], [2 * best.hausdorff.upper, "A is within"], [(best.floor + best.hausdorff.lower) / 2, "A is not within"]]) {
    await limit.fill(String(Number(value.toPrecision(3))));
    await page.locator("#reach", { hasText: words }).waitFor();
  }
  await page.waitForFunction(() => location.hash.includes("alignment="));
  const fresh = await browser.open(page.url());
  await fresh.locator("#reach", { hasText: "A is not within" }).waitFor();
  assert.equal(await fresh.locator("#alignment").innerText(), await page.locator("#alignment").innerText());
  assert.equal(await fresh.locator("[name=fit]").inputValue(), "min_max");
  await finish(fresh);
  await finish(page);
});

test("the moved mesh is kept as a copy, which takes the place of A", async () => {
  const page = await open();
  await waitForView(page);
  await page.getByRole("button", { name: "Align A onto B" }).click();
  await page.locator("#alignment .figures").waitFor();
  await page.getByRole("button", { name: "Keep as a copy" }).click();
  await page.locator("select[name=a] option:checked", { hasText: "turned.off, aligned" }).waitFor({ state: "attached" });
  assert(!page.url().includes("pose="));
  assert(await measure(page) < GAP);
  await finish(page);
});

test("pairs of places that are clicked bring A onto B, from where it is", async () => {
  const page = await open();
  await waitForView(page);
  await page.getByRole("button", { name: "By landmarks" }).click();
  await page.locator("#landmarks", { hasText: "3 pairs or more are wanted, 0 are there" }).waitFor();
  const canvas = await page.locator(".canvas canvas").boundingBox();
  /** Clicks a corner of one side of the box, looked at from before it. */
  async function click(role, point) {
    const [x, y] = await page.evaluate(async ({ role: which, point: place }) => {
      const stage = (await import("/dashboard/view/view.js")).currentStage();
      await stage.rest();
      const { toWindow } = await import("/dashboard/sketch/window.js");
      const at = stage.toScene(place);
      const { centre } = stage.models.get(which).frame;
      const middle = stage.toScene(centre);
      stage.eye.camera.position.copy(at.clone().sub(middle).setLength(1.5).add(middle));
      stage.eye.controls.target.copy(middle);
      stage.eye.controls.update();
      stage.drawNow();
      return toWindow(stage, place);
    }, { role, point });
    await page.mouse.click(canvas.x + x, canvas.y + y);
  }
  // Middles of faces: whoever looks at them from outside sees them.
  const { vertices, faces } = wedge();
  const middle = (face) => faces[face].reduce((sum, corner) => sum.map((x, k) => x + vertices[corner][k] / 4), [0, 0, 0]);
  const chosen = [7, 7 + 36, 7 + 72, 7 + 108].map(middle);
  for (const [place, point] of chosen.entries()) {
    await click("a", move(point));
    await page.locator("#landmarks", { hasText: "Click the same place of B." }).waitFor();
    await click("b", point);
    await page.locator("#landmarks", { hasText: place < 2 ? `${place + 1} are there` : `by the ${place + 1} pairs` }).waitFor();
  }
  assert.equal(await page.locator(".pins span.pin").count(), 4);
  await page.getByRole("button", { name: "Take the middle of the view" }).click(); // without a pointer
  await page.locator("#landmarks", { hasText: "Click the same place of B." }).waitFor();
  await page.getByRole("button", { name: "Take the last back" }).click();
  await page.locator("#landmarks", { hasText: "by the 4 pairs" }).waitFor();
  await page.getByRole("button", { name: "Align by these" }).click();
  await page.locator("#alignment .figures").waitFor();
  assert(Number(await figure(page, "RMS of the distances")) < BOUND);
  assert.equal(await page.locator(".pins span.pin").count(), 0);
  assert(await measure(page) < GAP);
  await finish(page);
});
