// Sketching a whole layout by strokes, and growing it into quads.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";

import { BUILD, Daemon } from "./support/daemon.js";
import { Browser, finish, waitForView } from "./support/page.js";
import { ball, ballLayout, off } from "./support/shapes.js";

let daemon;
let browser;
let mesh;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ({ mesh } = await daemon.client().meshes.create(off(ball(24)), { name: "ball.off" }));
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

/** Looks at a point from outside, and returns where points of the mesh then are on the screen. */
async function lookAt(page, target, points) {
  const inView = await page.evaluate(async ({ target: wanted, points: all }) => {
    const { currentStage } = await import("/dashboard/view/view.js");
    const { toWindow } = await import("/dashboard/sketch/window.js");
    const stage = currentStage();
    stage.eye.camera.position.copy(stage.toScene(wanted)).multiplyScalar(5);
    stage.eye.controls.target.set(0, 0, 0);
    stage.eye.controls.update();
    stage.drawNow();
    return all.map((point) => toWindow(stage, point));
  }, { target, points });
  const box = await page.locator(".canvas canvas").boundingBox();
  return inView.map(([x, y]) => [x + box.x, y + box.y]);
}

async function draw(page, track) {
  await page.mouse.move(...track[0]);
  await page.mouse.down();
  for (const place of track.slice(1)) await page.mouse.move(...place);
  await page.mouse.up();
}

const says = (page, words) => page.locator("#sketch", { hasText: words }).waitFor();

test("a whole layout is drawn, edited, undone and grown into a thousand quads", async () => {
  const page = await browser.open(`${daemon.url}/#sketch?a=${mesh.id}`);
  await waitForView(page);
  await page.locator("canvas.draws").waitFor();
  await says(page, "0 curves, 0 patches");
  const { curves } = ballLayout(8);
  for (const [place, { points }] of curves.entries()) {
    await draw(page, await lookAt(page, points[4], points));
    await says(page, `${place + 1} curve`);
  }
  await says(page, "12 curves, 6 patches; the layout is whole");
  assert.equal(await page.locator(".issues li").count(), 0);

  // A click chooses a curve; keys take it away and bring it back.
  const [middle] = await lookAt(page, curves[0].points[4], [curves[0].points[4]]);
  await page.mouse.click(...middle);
  await page.getByRole("button", { name: "Split" }).click();
  await says(page, "13 curves");
  assert(await page.locator(".issues li").count() > 0);
  await page.keyboard.press("Control+z");
  await says(page, "12 curves, 6 patches");
  await page.keyboard.press("Control+Shift+z");
  await says(page, "13 curves");
  await page.keyboard.press("Control+z");
  await says(page, "12 curves, 6 patches");
  await page.mouse.click(...middle);
  await page.keyboard.press("Delete");
  await says(page, "11 curves");
  await page.locator(".issues button").first().click();
  await page.keyboard.press("Control+z");
  await says(page, "12 curves, 6 patches; the layout is whole");
  await page.reload();
  await says(page, "12 curves, 6 patches; the layout is whole");

  await page.getByRole("link", { name: "Remesh" }).last().click();
  await page.getByRole("button", { name: "Start from the layout" }).click();
  await page.locator("#remesh", { hasText: "One quad a patch" }).waitFor();
  await page.getByRole("button", { name: "One step" }).click();
  await page.locator("#remesh", { hasText: "Refined" }).waitFor();
  assert.equal(await page.locator("tbody tr").count(), 1);
  await page.getByRole("button", { name: "Run to the goal" }).click();
  await page.locator("#remesh", { hasText: "too many quads" }).waitFor();
  const quads = Number((await page.locator(".figures dd").first().innerText()).replace(",", ""));
  assert(quads > 250 && quads <= 1000, String(quads));
  const [lower, upper] = (await page.locator("tbody tr td:nth-child(3)").first().innerText()).match(/[\d.]+(?= %)/g).map(Number);
  await page.getByRole("button", { name: "Map the error" }).click();
  await page.locator(".legend").waitFor();

  await page.getByLabel("Format of the download").selectOption("off");
  const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Download" }).click()]);
  const grown = path.join(daemon.folder, "grown.off");
  const source = path.join(daemon.folder, "source.off");
  writeFileSync(grown, readFileSync(await file.path()));
  writeFileSync(source, off(ball(24)));
  const { upper_relative: checked } = JSON.parse(execFileSync(path.join(BUILD, "quadmesh"), ["hausdorff", source, grown, "--json"], { encoding: "utf8" }));
  assert(100 * checked >= 0.995 * lower && 100 * checked <= 1.005 * upper, `${lower} ${upper} ${checked}`); // three digits
  await finish(page);
});
