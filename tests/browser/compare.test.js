// The page that compares: right numbers, the chart, stopping, threshold, heat map, links, exports.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, drawnShare, finish, waitForView } from "./support/page.js";
import { HEAP_DISTANCE, SPHERE_DISTANCE, SPHERE_TURN, ball, heaps, moved, off, sphere } from "./support/shapes.js";

let daemon;
let browser;
let ids;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  const [low, high] = heaps();
  const meshes = { a: sphere(), b: sphere(SPHERE_TURN), low, high };
  ids = {};
  for (const [name, mesh] of Object.entries(meshes)) {
    ids[name] = (await daemon.client().meshes.create(off(mesh), { name: `${name}.off` })).mesh.id;
  }
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const number = async (page, id) => Number((await page.locator(`#${id} .value`).innerText()).replaceAll(",", ""));
const words = (page, text) => page.locator("#outcome", { hasText: text }).waitFor();

async function choose(page, a, b) {
  await page.locator("select[name=a]").selectOption(ids[a]);
  await page.locator("select[name=b]").selectOption(ids[b]);
}

test("a comparison runs to its end with the right numbers", async () => {
  const page = await browser.open(`${daemon.url}/#compare`);
  await page.getByText("Choose two meshes to compare").waitFor();
  await choose(page, "a", "b");
  await page.getByRole("button", { name: "Measure" }).click();
  await words(page, "Done");
  const [lower, upper] = [await number(page, "lower"), await number(page, "upper")];
  assert(lower <= SPHERE_DISTANCE * 1.00000001 && upper >= SPHERE_DISTANCE * 0.99999999, `${lower} ${upper}`);
  assert(upper - lower < 4e-6);
  assert(await number(page, "iterations") > 100);
  await waitForView(page);
  assert(await drawnShare(page) > 0.1);
  assert(await page.getByRole("button", { name: "Show the farthest points" }).isEnabled());
  const chart = await page.locator("canvas.drawing").first().getAttribute("aria-label");
  assert(chart.includes("0.000493"), chart);

  const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Bounds, CSV" }).click()]);
  const rows = readFileSync(await file.path(), "utf8").trim().split("\n");
  assert.equal(rows[0], "elapsed_ms,lower,upper,iterations,projections");
  assert(Math.abs(Number(rows.at(-1).split(",")[1]) - lower) < 1e-12);
  await finish(page);
});

test("a search is stopped at any time, and its bounds hold", async () => {
  const page = await browser.open(`${daemon.url}/#compare`);
  await choose(page, "low", "high");
  await page.locator("select[name=quads]").selectOption("bilinear");
  await page.locator("input[name=tolerance]").fill("1e-12");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.waitForFunction(() => document.querySelector("#upper .value").textContent !== "–");
  await page.getByRole("button", { name: "Stop" }).click();
  await words(page, "Stopped; the bounds hold");
  const [lower, upper] = [await number(page, "lower"), await number(page, "upper")];
  assert(lower <= HEAP_DISTANCE * 1.000001 && upper >= HEAP_DISTANCE * 0.999999 && upper > lower);
  assert(await page.getByRole("button", { name: "Stop" }).isDisabled());
  await finish(page);
});

test("a threshold gets its verdict", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.a}&b=${ids.b}&threshold=0.001`);
  await page.locator(`select[name=a] option[value="${ids.a}"]:checked`).waitFor({ state: "attached" });
  assert.equal(await page.locator("input[name=threshold]").inputValue(), "0.001");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.getByText("The distance is below the threshold 0.001.").waitFor();
  await page.locator("input[name=threshold]").fill("0.0004");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.getByText("The distance is above the threshold 0.0004.").waitFor();
  await finish(page);
});

test("the heat map comes with colour bar, histogram and percentiles; a link brings all of it back", async () => {
  const page = await browser.open(`${daemon.url}/#compare`);
  await choose(page, "a", "b");
  await page.getByRole("button", { name: "Measure" }).click();
  await words(page, "Done");
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend").waitFor();
  assert.equal(await page.locator("#deviation tbody tr").count(), 8);
  assert.match(await page.locator("#deviation").innerText(), /Mean\s+1\.6\d+e-4 ±|Mean\s+0\.00016\d+ ±/);
  assert.match(await page.locator(".legend .ticks span").last().innerText(), /^0\.00049\d$/);
  const [csv] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Distances, CSV" }).click()]);
  assert.equal(readFileSync(await csv.path(), "utf8").trim().split("\n").length, 4901);
  const [png] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Picture, PNG" }).click()]);
  assert.equal(readFileSync(await png.path()).subarray(1, 4).toString(), "PNG");
  await page.waitForTimeout(800); // the flight to the farthest points
  await page.getByRole("button", { name: "Copy link" }).click();
  await page.waitForFunction(() => location.hash.includes("eye="));
  const link = page.url();

  const other = await browser.open(link);
  await words(other, "Done");
  assert.equal(await other.locator("#lower .value").innerText(), await page.locator("#lower .value").innerText());
  await other.locator(".legend").waitFor();
  const eye = (where) => where.evaluate(() => new URLSearchParams(location.hash.split("?")[1]).get("eye"));
  await other.getByRole("button", { name: "Copy link" }).click();
  const [here, there] = [await eye(page), await eye(other)].map((text) => text.split(",").map(Number));
  here.forEach((value, place) => assert(Math.abs(value - there[place]) < 1e-4, `${here} ${there}`));
  await finish(page);
  await finish(other);
});

test("signed distances distinguish inside from outside; a link restores the view", async () => {
  const [near, whole] = await Promise.all([moved(ball(8), [0.3, 0, 0]), ball(16)].map(async (mesh, place) =>
    (await daemon.client().meshes.create(off(mesh), { name: `ball_${place}.off` })).mesh.id));
  const page = await browser.open(`${daemon.url}/#compare?a=${near}&b=${whole}`);
  await waitForView(page);
  assert.equal(await page.getByRole("button", { name: "Signed" }).count(), 0);
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator("#deviation").waitFor();
  await page.locator(".stage-tools").getByRole("button", { name: "Edges" }).click();
  await page.getByRole("button", { name: "Signed" }).click();
  await page.locator(".legend", { hasText: "inside B, or outside" }).waitFor();
  const ticks = await page.locator(".legend .ticks span").allInnerTexts();
  assert.deepEqual([Number(ticks[0]), ticks[1]], [-Number(ticks[2]), "0"]);
  const [csv] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Distances, CSV" }).click()]);
  const rows = readFileSync(await csv.path(), "utf8").trim().split("\n").slice(1).map((row) => row.split(","));
  moved(ball(8), [0.3, 0, 0]).vertices.forEach((point, vertex) => {
    const radius = Math.hypot(...point);
    if (radius > 1.001 || radius < 0.97) assert.equal(rows[vertex][2], radius > 1 ? "outside" : "inside"); // between, facets decide
  });
  await page.getByRole("button", { name: "Copy link" }).click();
  await page.waitForFunction(() => location.hash.includes("eye="));

  const other = await browser.open(page.url());
  await other.locator(".legend", { hasText: "inside B, or outside" }).waitFor();
  const look = (where) => where.locator(".stage-tools button").evaluateAll((all) => all.map((one) => `${one.textContent} ${one.getAttribute("aria-pressed")}`));
  assert.deepEqual(await look(other), await look(page));
  assert((await look(page)).includes("Edges true") && (await look(page)).includes("B false"));
  await finish(page);
  await finish(other);
});

test("a fault of the request is shown in words", async () => {
  const page = await browser.open(`${daemon.url}/#compare`);
  await choose(page, "a", "b");
  const gone = (await daemon.client().meshes.create(off(sphere(0.2, 8, 16)), { name: "gone.off" })).mesh.id;
  await page.reload();
  await page.locator("select[name=b]").selectOption(gone);
  await page.locator("select[name=a]").selectOption(ids.a);
  await daemon.client().meshes.delete(gone);
  await page.getByRole("button", { name: "Measure" }).click();
  await page.locator("#outcome.fault", { hasText: "/b" }).waitFor();
  await finish(page);
});
