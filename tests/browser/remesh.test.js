// Quads of a surface at once, by one button: watched, stopped, shown with their proven distance, opened again, and downloaded.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, waitForView } from "./support/page.js";
import { off, roundedBox } from "./support/shapes.js";

let daemon;
let browser;
let mesh;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ({ mesh } = await daemon.client().meshes.create(off(roundedBox(12)), { name: "box.off" }));
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const says = (page, words) => page.locator("#once", { hasText: words }).waitFor();
const form = (page) => page.getByRole("form", { name: "Quads at once" });
const jobOf = (page) => new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("job");

async function open(hash = `#remesh?a=${mesh.id}`) {
  const page = await browser.open(`${daemon.url}/${hash}`);
  await form(page).waitFor();
  await waitForView(page);
  return page;
}

async function ask(page, { quads = "", distance = "", blocks = false }) {
  await form(page).getByLabel("About so many quads").fill(quads);
  await form(page).getByLabel("No farther than").fill(distance);
  await form(page).getByLabel("In patches").setChecked(blocks);
  await form(page).getByRole("button", { name: "Remesh" }).click();
}

/** What the view shows, by the ids of its meshes. */
const shown = (page) => page.evaluate(async () => {
  const { currentStage } = await import("/dashboard/view/view.js");
  return [...currentStage().models.values()].map((model) => model.mesh.id);
});

test("quads are made by a button, and shown with their distance", async () => {
  const page = await open();
  await ask(page, { quads: "600" });
  await says(page, "proven to be no farther from the surface than");
  const { result } = await daemon.client().jobs.get(jobOf(page));
  await says(page, `${result.quads.toLocaleString("en")} quads, proven`);
  assert((await shown(page)).includes(result.mesh), "the quads are in the view");
  const text = await page.locator("#panel").textContent();
  for (const words of ["upper bound", "both are proven", "Irregular vertices", "Folded quads0"]) assert(text.includes(words), words);
  await page.getByRole("button", { name: "Map the error" }).click();
  await page.locator("#remesh", { hasText: "from the quads in the mean" }).waitFor();

  const saved = page.waitForEvent("download");
  await page.getByLabel("Format with texture coordinates").selectOption("obj");
  await page.getByRole("button", { name: "Save with texture coordinates" }).click();
  const lines = readFileSync(await (await saved).path(), "utf8").split("\n");
  assert.equal(lines.filter((line) => line.startsWith("f ")).length, result.quads);
  assert(lines.some((line) => line.startsWith("vt ")) && lines.some((line) => /^f \d+\/\d+ /.test(line)));

  // The address shows it again, and so does the list of jobs.
  const again = await open(new URL(page.url()).hash);
  await says(again, `${result.quads.toLocaleString("en")} quads, proven`);
  await again.evaluate(() => { location.hash = "#jobs"; });
  await again.locator("tbody tr", { hasText: "Quads at once" }).getByRole("link").first().click();
  await says(again, `${result.quads.toLocaleString("en")} quads, proven`);
  await finish(again);
  await finish(page);
});

test("until a distance is reached, and in patches", async () => {
  const page = await open();
  await ask(page, { distance: "0.5" });
  await says(page, "proven");
  const near = (await daemon.client().jobs.get(jobOf(page))).result;
  assert(near.reached && near.hausdorff.upper_relative <= 0.005);
  await ask(page, { quads: "500", distance: "0.00001", blocks: true });
  await says(page, "the distance was not reached");
  const far = (await daemon.client().jobs.get(jobOf(page))).result;
  await says(page, `in ${far.patches.toLocaleString("en")} patches`);
  await finish(page);
});

test("it can be stopped, goes on when the page is left, and says what is wrong", async () => {
  const page = await open();
  await ask(page, { quads: "300000" });
  await page.locator(".searching", { hasText: "Making quads, 300,000 quads" }).waitFor();
  const watched = new URL(page.url()).hash;
  const other = await open(watched);
  await other.locator(".searching", { hasText: "Making quads" }).waitFor();
  await other.evaluate(() => { location.hash = "#meshes"; });
  await other.locator('body[data-page="meshes"]').waitFor();
  assert.equal((await daemon.client().jobs.get(jobOf(page))).state, "running");
  await finish(other);
  await page.getByRole("button", { name: "Stop" }).and(page.locator(".searching:not([hidden]) button")).click();
  await says(page, "Stopped");
  assert.equal((await daemon.client().jobs.get(jobOf(page))).state, "canceled");

  const { mesh: cloud } = await daemon.client().meshes.create("0 0 0\n1 0 0\n0 1 0\n0 0 1\n", { name: "cloud.xyz" });
  const points = await open(`#remesh?a=${cloud.id}`);
  await ask(points, { quads: "100" });
  await points.locator(".is-fault", { hasText: "too few for a surface" }).waitFor();
  await finish(points);
  await finish(page);
});
