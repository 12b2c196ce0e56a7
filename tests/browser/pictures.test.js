// Pictures of the main views, in build/pictures to be looked at. QM_PICTURES names a folder that gets small ones for the README.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, drawnShare, finish, fly, keepPicture, rest, viewOf, waitForView } from "./support/page.js";
import { hills, hillsLayout, moved, off, roundedBox } from "./support/shapes.js";
import { waitForPen } from "./support/strokes.js";

let daemon;
let browser;
const ids = {};
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  const client = daemon.client();
  const meshes = {
    coarse: ["hills coarse.off", hills(6)], fine: ["hills.off", hills(32)],
    box: ["box.off", roundedBox(12)], other: ["box moved.off", moved(roundedBox(12), [1.2, 0.5, 0.35])],
  };
  for (const [key, [name, mesh]] of Object.entries(meshes)) ids[key] = (await client.meshes.create(off(mesh), { name })).mesh.id;
  ids.layout = (await client.layouts.create({ mesh: ids.fine, ...hillsLayout() })).id;
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

/** Takes a picture that must show something. */
async function take(page, name) {
  assert(await drawnShare(page) > 0.08, name);
  await keepPicture(page, await page.screenshot({ animations: "disabled" }), name);
}

/** What leads to each view. */
const VIEWS = {
  meshes: {
    hash: () => `#meshes?mesh=${ids.fine}`, act: async (page) => {
      await page.locator("img.thumbnail").nth(3).waitFor();
    } },
  compare: {
    hash: () => `#compare?a=${ids.fine}&b=${ids.coarse}&eye=-1.45,0.6,0.75,0,0,0`, act: async (page) => {
      await fly(page, () => page.getByRole("button", { name: "Measure" }).click());
      await page.locator("#outcome", { hasText: "Done" }).waitFor();
      await page.getByRole("button", { name: "Map the distances" }).click();
      await page.locator(".legend").waitFor();
      await page.getByRole("button", { name: "Compare both ways" }).click();
      await page.locator(".pin").first().waitFor({ state: "attached" });
      await page.getByRole("button", { name: "Fit" }).click();
      await page.evaluate(() => { document.getElementById("panel").scrollTop = 0; });
    } },
  collide: {
    hash: () => `#collide?a=${ids.box}&b=${ids.other}`, act: async (page) => {
      await fly(page, () => page.getByRole("button", { name: "Find collisions" }).click());
      await page.locator("#contact").waitFor();
      await page.getByRole("button", { name: "Fit" }).click();
    } },
  sketch: {
    hash: () => `#sketch?a=${ids.fine}&layout=${ids.layout}`, act: async (page) => {
      await waitForPen(page);
      await page.waitForFunction((view) => view.currentStage().models.get("a").regions, await viewOf(page));
    } },
  remesh: {
    hash: () => `#remesh?a=${ids.fine}&layout=${ids.layout}`, act: async (page) => {
      await page.getByRole("button", { name: "Start from the layout" }).click();
      await page.locator("#remesh", { hasText: "One quad a patch" }).waitFor();
      await page.getByRole("button", { name: "Run to the goal" }).click();
      await page.locator("#remesh", { hasText: "more than 1,000 quads" }).waitFor();
    } },
};

const SHAPES = [["", { viewport: { width: 1280, height: 800 }, colorScheme: "light" }, Object.keys(VIEWS)],
  ["-dark", { viewport: { width: 360, height: 740 }, colorScheme: "dark" }, ["compare", "sketch"]]];
for (const [suffix, options, names] of SHAPES) {
  test(`the main views are worth a picture${suffix && ", small and dark"}`, async () => {
    const page = await browser.open(`${daemon.url}/#jobs`, options);
    for (const name of names) {
      await page.evaluate((hash) => { location.hash = hash; }, VIEWS[name].hash());
      await page.locator(`body[data-page="${name}"]`).waitFor();
      await waitForView(page);
      await VIEWS[name].act(page);
      await rest(page);
      await take(page, `${name}${suffix}`);
    }
    await finish(page);
  });
}
