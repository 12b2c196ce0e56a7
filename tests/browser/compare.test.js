// The page that compares: right numbers, the chart, stopping, limit, heat map, links, exports.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, drawnShare, finish, fly, rest, viewOf, waitForView } from "./support/page.js";
import { HEAP_DISTANCE, SPHERE_DISTANCE, SPHERE_TURN, ball, chance, heaps, moved, off, sphere } from "./support/shapes.js";

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
  await page.locator("input[name=gap]").fill("1e-12");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.waitForFunction(() => document.querySelector("#upper .value").textContent !== "–");
  await page.getByRole("button", { name: "Stop" }).click();
  await words(page, "Stopped; the bounds hold");
  const [lower, upper] = [await number(page, "lower"), await number(page, "upper")];
  assert(lower <= HEAP_DISTANCE * 1.000001 && upper >= HEAP_DISTANCE * 0.999999 && upper > lower);
  assert(await page.getByRole("button", { name: "Stop" }).isDisabled());
  await finish(page);
});

test("a limit gets its verdict", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.a}&b=${ids.b}&limit=0.001`);
  await page.locator(`select[name=a] option[value="${ids.a}"]:checked`).waitFor({ state: "attached" });
  assert.equal(await page.locator("input[name=limit]").inputValue(), "0.001");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.getByText("The distance is below the limit 0.001.").waitFor();
  await page.locator("input[name=limit]").fill("0.0004");
  await page.getByRole("button", { name: "Measure" }).click();
  await page.getByText("The distance is above the limit 0.0004.").waitFor();
  await page.getByRole("link", { name: "Jobs" }).click();
  await page.locator("tbody tr", { hasText: "above the limit 0.0004" }).waitFor();
  await finish(page);
});

test("the heat map comes with colour bar, histogram and percentiles; a link brings all of it back", async () => {
  const page = await browser.open(`${daemon.url}/#compare`);
  await choose(page, "a", "b");
  await page.getByRole("button", { name: "Measure" }).click();
  await words(page, "Done");
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend").waitFor();
  assert.equal(await page.locator("#deviation tbody tr").count(), 3 + 8);
  assert.match(await page.locator("#deviation").innerText(), /Mean\s+1\.6\d* ± 0\.0\d+ e-4/);
  assert.match(await page.locator(".legend .ticks span").last().innerText(), /^0\.00049\d$/);
  assert.match(await page.locator(".legend").innerText(), /Distance of a\.off from b\.off[\s\S]*off by [\d.e-]+ at most/);
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
  await page.locator(".legend", { hasText: "outside" }).waitFor();
  const ticks = await page.locator(".legend .ticks span").allInnerTexts();
  assert.match(ticks.join(), /^(-[\d.]+) inside,0,outside \+[\d.]+$/);
  assert.equal(ticks[0].replace(" inside", ""), ticks[2].replace("outside +", "-"));
  const [csv] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Distances, CSV" }).click()]);
  const rows = readFileSync(await csv.path(), "utf8").trim().split("\n").slice(1).map((row) => row.split(","));
  moved(ball(8), [0.3, 0, 0]).vertices.forEach((point, vertex) => {
    const radius = Math.hypot(...point);
    if (radius > 1.001 || radius < 0.97) assert.equal(rows[vertex][2], radius > 1 ? "outside" : "inside"); // between, facets decide
  });
  await page.getByRole("button", { name: "Copy link" }).click();
  await page.waitForFunction(() => location.hash.includes("eye="));

  const other = await browser.open(page.url());
  await other.locator(".legend", { hasText: "outside" }).waitFor();
  const look = (where) => where.locator(".stage-tools button").evaluateAll((all) => all.map((one) => `${one.textContent} ${one.getAttribute("aria-pressed")}`));
  assert.deepEqual(await look(other), await look(page));
  assert((await look(page)).includes("Edges true") && (await look(page)).includes("B false"));
  await finish(page);
  await finish(other);
});

test("bands of signed distances: the daemon's shares of both directions, their colours, and a link that brings them back", async () => {
  const { shareBetween } = await import("../../clients/dashboard/core/format.js");
  const [near, whole] = await Promise.all([moved(ball(8), [0.3, 0, 0]), ball(16)].map(async (mesh, place) =>
    (await daemon.client().meshes.create(off(mesh), { name: `banded_${place}.off` })).mesh.id));
  const page = await browser.open(`${daemon.url}/#compare?a=${near}&b=${whole}&heat=1&signed=1`, { viewport: { width: 1300, height: 900 } });
  await page.locator(".legend", { hasText: "sides proven" }).waitFor();
  await page.locator(".range").getByRole("button", { name: "Bands" }).click();
  await page.locator("input[name=limit-in]").fill("-0.1");
  // The answer to the first limit comes while the second one is typed, and does not write over it.
  const redrawn = page.waitForResponse((reply) => reply.url().includes("/v1/jobs"));
  await page.locator("input[name=limit-in]").press("Tab");
  await page.locator("input[name=limit-out]").fill("0.2");
  await redrawn;
  await page.locator("#signed tr", { hasText: "Share from -0.1 to" }).waitFor();
  await page.locator("input[name=limit-out]").press("Tab");
  const bands = [[null, -0.1], [-0.1, 0.2], [0.2, null]];
  const names = ["Share below -0.1", "Share from -0.1 to 0.2", "Share above 0.2"];
  await page.locator("#signed tr", { hasText: names[1] }).waitFor();
  const ask = (request) => daemon.client().jobs.create({ a: near, b: whole, sign: "outside", bands, ...request }, { wait: 30 }).then(({ result }) => result);
  const { signed } = await ask({ type: "deviation", accuracy: 0.02, pieces: 262144 });
  const shown = async (table, where = page) => Promise.all(names.map((name) => where.locator(`${table} tr`, { hasText: name }).locator("td").allInnerTexts()));
  assert.deepEqual(await shown("#signed"), signed.bands.map((share) => [shareBetween(share)]));
  await page.locator(".legend .band", { hasText: "more than 0.100 inside" }).waitFor();
  await page.getByRole("button", { name: "Compare both ways" }).click();
  await page.locator("#comparison", { hasText: "The sides are proven." }).waitFor();
  const both = await ask({ type: "comparison" });
  const cells = await shown("#comparison");
  assert.deepEqual(cells, both.a_to_b.signed.bands.map((_, place) => ["", ...[both.a_to_b, both.b_to_a].map(({ signed: { bands: all } }) => shareBetween(all[place]))]));
  const other = await browser.open(page.url());
  await other.locator("#comparison", { hasText: "The sides are proven." }).waitFor();
  await other.locator(".legend .band", { hasText: "more than 0.200 outside" }).waitFor();
  assert.deepEqual([await shown("#signed", other), await shown("#comparison", other)], [await shown("#signed"), cells]);
  await finish(other);
  await finish(page);
});

test("shares are written so that they hold what they stand for", async () => {
  const { shareBetween } = await import("../../clients/dashboard/core/format.js");
  assert.equal(shareBetween({ lower: 0.25, upper: 0.25 }), "25.0 %");
  assert.equal(shareBetween({ lower: 0, upper: 0.0123456 }), "0 to 1.24 %");
  assert.equal(shareBetween({ lower: 0.99994, upper: 1 }), "99.9 to 100 %");
  assert.equal(shareBetween({ lower: 0, upper: 6.85e-13 }), "0 to 0.0001 %");
  const random = chance(11);
  for (let n = 0; n < 5000; n++) {
    const lower = 10 ** (-9 * random());
    const upper = Math.min(1, lower * (1 + random() * 10 ** (-6 * random())));
    const [low, high] = shareBetween({ lower, upper }).replace(" %", "").split(" to ").map((text) => Number(text) / 100);
    assert(upper === lower || (low <= lower * (1 + 1e-12) && high >= upper * (1 - 1e-12) && low > 0.98 * lower - 1e-6 && high < 1.02 * upper + 1e-6), `seed 11: ${lower} ${upper}`);
  }
});

test("of a mesh that is inside out the inside is the same", async () => {
  const whole = ball(16);
  const turned = { ...whole, faces: whole.faces.map((corners) => [...corners].reverse()) };
  const [near, inside_out] = await Promise.all([moved(ball(8), [0.3, 0, 0]), turned].map(async (mesh, place) =>
    (await daemon.client().meshes.create(off(mesh), { name: `turned_${place}.off` })).mesh.id));
  const page = await browser.open(`${daemon.url}/#compare?a=${near}&b=${inside_out}&heat=1&signed=1`);
  await page.locator(".legend", { hasText: "sides proven" }).waitFor();
  const [csv] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Distances, CSV" }).click()]);
  const rows = readFileSync(await csv.path(), "utf8").trim().split("\n").slice(1).map((row) => row.split(","));
  moved(ball(8), [0.3, 0, 0]).vertices.forEach((point, vertex) => {
    const radius = Math.hypot(...point);
    if (radius > 1.001 || radius < 0.97) assert.equal(rows[vertex][2], radius > 1 ? "outside" : "inside");
  });
  const farthest = await page.locator("#signed tr", { hasText: "Farthest" }).locator("td").allInnerTexts();
  assert(Math.abs(Number(farthest[0].split(" ")[0]) - 0.3) < 0.03, farthest.join());
  await finish(page);
});

test("a mesh that is open has no proven sides: the page tells why, and offers those of the normals as not proven", async () => {
  const [square, hill] = await uploadHill();
  const page = await browser.open(`${daemon.url}/#compare?a=${square}&b=${hill}&heat=1`);
  await page.locator(".legend").waitFor();
  await page.getByRole("button", { name: "Signed" }).click();
  await page.locator("#no-sign", { hasText: "No side is proven: " }).waitFor();
  assert.match(await page.locator("#no-sign").innerText(), /edge/);
  assert(await page.getByRole("button", { name: "Signed" }).isDisabled());
  assert.equal(await page.locator("#signed").count(), 0);
  await page.getByRole("button", { name: "By the normals" }).click();
  await page.locator(".legend", { hasText: "sides by the normals, not proven" }).waitFor();
  await page.locator("#signed", { hasText: "not proven" }).waitFor();
  const other = await browser.open(page.url());
  await other.locator(".legend", { hasText: "sides by the normals, not proven" }).waitFor();
  await finish(page);
  await finish(other);
});

test("the parts of A beyond the limit are listed, bordered, and flown to", async () => {
  const steps = 40;
  const hills = { vertices: [], faces: [] };
  const bump = (x, y, cx, height) => height * Math.max(0, 1 - ((x - cx) ** 2 + (y - 0.5) ** 2) / 0.04) ** 2;
  for (let n = 0; n < (steps + 1) ** 2; n++) {
    const [x, y] = [Math.floor(n / (steps + 1)) / steps, (n % (steps + 1)) / steps];
    hills.vertices.push([x, y, bump(x, y, 0.25, 0.2) + bump(x, y, 0.75, 0.3)]);
  }
  for (let i = 0; i < steps; i++) for (let j = 0; j < steps; j++) hills.faces.push([[0, 0], [1, 0], [1, 1], [0, 1]].map(([u, v]) => (i + u) * (steps + 1) + j + v));
  const two = (await daemon.client().meshes.create(off(hills), { name: "two hills.off" })).mesh.id;
  const [square] = await uploadHill();
  const page = await browser.open(`${daemon.url}/#compare?a=${two}&b=${square}&limit=0.1&eye=0,0,1.6,0,0,0`, { viewport: { width: 1300, height: 900 } });
  await waitForView(page);
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.getByText("2 parts of A beyond 0.1:").waitFor();
  const parts = await page.getByRole("list", { name: "Parts beyond the limit" }).getByRole("button").allInnerTexts();
  assert.match(parts[0], /^1: up to 0\.3\d* ± [\d.]+, area 0\.\d+ ± [\d.]+$/);
  assert(Math.abs(Number(/up to ([\d.]+)/.exec(parts[1])[1]) - 0.2) < 0.01, parts[1]);
  await page.locator(".legend").waitFor();
  await page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.fromText("0,0,1.6,0,0,0"));
  const target = () => page.evaluate(async () => {
    const { eye: { controls }, frame } = (await import("/dashboard/view/view.js")).currentStage();
    return controls.target.toArray().map((x, k) => x / frame.scale + frame.centre[k]);
  });
  for (const [place, x] of [[1, 0.25], [0, 0.75]]) {
    await fly(page, () => page.getByRole("list", { name: "Parts beyond the limit" }).getByRole("button").nth(place).click());
    assert(Math.abs((await target())[0] - x) < 0.05, `${await target()}`);
    // The border that is drawn strongly goes round the part: where the hill is as high as the limit. The worker finds it meanwhile.
    await page.waitForFunction(([view, middle]) => {
      const { layers, frame } = view.currentStage();
      return layers.get("marks").ribbons.some(({ width, points: [{ x: at }] }) => width > 2 && Math.abs(at / frame.scale + frame.centre[0] - middle) < 0.25);
    }, [await viewOf(page), x]);
    const drawn = await page.evaluate(async () => {
      const { overlay, frame } = (await import("/dashboard/view/view.js")).currentStage();
      const { position, side } = overlay.group.children[0].geometry.attributes;
      const all = Array.from({ length: position.count }, (_, n) => [0, 1, 2].map((k) => position.getComponent(n, k) / frame.scale + frame.centre[k]));
      return all.filter((_, n) => side.getY(n) > 2);
    });
    assert(drawn.length > 20 && drawn.every(([px, py, pz]) => Math.hypot(px - x, py - 0.5) < 0.2 && pz < 0.15), `${drawn.length} corners`);
  }
  await finish(page);
});

/** A flat square of one quad, and one with a hill in its middle that the square's corners know nothing of. */
async function uploadHill() {
  const steps = 24;
  const hill = { vertices: [], faces: [] };
  for (let n = 0; n < (steps + 1) ** 2; n++) {
    const [x, y] = [Math.floor(n / (steps + 1)) / steps, (n % (steps + 1)) / steps];
    hill.vertices.push([x, y, 0.3 * Math.max(0, 1 - ((x - 0.5) ** 2 + (y - 0.5) ** 2) / 0.16) ** 2]);
  }
  for (let i = 0; i < steps; i++) for (let j = 0; j < steps; j++) hill.faces.push([[0, 0], [1, 0], [1, 1], [0, 1]].map(([u, v]) => (i + u) * (steps + 1) + j + v));
  const square = { vertices: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], faces: [[0, 1, 2, 3]] };
  return Promise.all([square, hill].map(async (mesh, place) => (await daemon.client().meshes.create(off(mesh), { name: `hill_${place}.off` })).mesh.id));
}

/** The colours of the view at shares of its width and height. */
const coloursAt = (page, places) => page.evaluate(async (all) => {
  const stage = (await import("/dashboard/view/view.js")).currentStage();
  await stage.rest();
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [stage.canvas.width, stage.canvas.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(stage.canvas, 0, 0);
  return all.map(([x, y]) => [...context.getImageData(Math.floor(x * copy.width), Math.floor(y * copy.height), 1, 1).data].slice(0, 3));
}, places);

const SQUARE_FROM_ABOVE = "&eye=0,0,1.6,0,0,0"; // half of the view's height shows 0.5 of its diagonal

test("a coarse mesh shows distances between its corners, and the value at each place can be read", async () => {
  const [square, hill] = await uploadHill();
  const page = await browser.open(`${daemon.url}/#compare?a=${square}&b=${hill}${SQUARE_FROM_ABOVE}`);
  await waitForView(page);
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend", { hasText: "off by" }).waitFor();
  await page.locator(".stage-tools").getByRole("button", { name: "B", exact: true }).click();
  await waitForView(page);
  const [middle, edge] = await coloursAt(page, [[0.5, 0.5], [0.5, 0.78]]);
  assert(middle[0] > 2 * edge[0] && middle[0] > 150, `middle ${middle}, edge ${edge}`); // navy has little red
  const most = Number((await page.locator("#deviation tr", { hasText: "Maximum" }).locator("td").innerText()).split(" ")[0]);

  const box = await page.locator(".canvas canvas").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.locator(".tip:not([hidden])").waitFor();
  const value = Number(await page.locator(".tip").innerText());
  assert(value > 0.9 * most && value <= 1.0001 * most, `${value} of ${most}`);
  await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
  await page.locator(".pin").waitFor();
  await page.getByRole("button", { name: "Value in the middle" }).click();
  await page.locator(".pin").nth(1).waitFor();
  await page.locator(".pin").last().click();
  assert.equal(await page.locator(".pin").count(), 1);
  const pinned = await page.locator(".pin").innerText();
  const [png] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Picture, PNG" }).click()]);
  assert(readFileSync(await png.path()).length > 10000);

  const other = await browser.open(page.url());
  await other.locator(".pin").waitFor();
  assert.equal(await other.locator(".pin").innerText(), pinned);
  await finish(page);
  await finish(other);
});

test("the colours' range is the user's, stays, and is in the link; bands show what is within limits", async () => {
  const [square, hill] = await uploadHill();
  const page = await browser.open(`${daemon.url}/#compare?a=${square}&b=${hill}&heat=1${SQUARE_FROM_ABOVE}`);
  await page.locator(".legend").waitFor();
  await page.locator("input[name=high]").fill("0.05");
  await page.locator("input[name=high]").press("Tab");
  await page.locator(".legend .ticks", { hasText: "≥ 0.0500" }).waitFor();
  await page.getByRole("button", { name: "Swap A and B" }).click();
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend", { hasText: "hill_1.off from hill_0.off" }).waitFor();
  await page.locator(".legend .ticks", { hasText: "≥ 0.0500" }).waitFor();
  await page.getByRole("button", { name: "Swap A and B" }).click();
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend", { hasText: "hill_0.off from hill_1.off" }).waitFor();

  await page.locator("input[name=limit]").fill("0.04");
  await page.getByRole("button", { name: "Bands" }).click();
  await page.locator(".legend .band", { hasText: "within 0.0400" }).waitFor();
  await page.waitForFunction(() => location.hash.includes("limits=-0.04,0.04"));
  await page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.fromText("0,0,1.6,0,0,0"));
  await waitForView(page);
  const [[red, green], [edgeRed, edgeGreen]] = await coloursAt(page, [[0.5, 0.5], [0.5, 0.78]]);
  assert(red > 2 * green && edgeGreen > 1.5 * edgeRed, `${red} ${green}, ${edgeRed} ${edgeGreen}`);
  const other = await browser.open(page.url());
  await other.locator(".legend .band", { hasText: "beyond 0.0400" }).waitFor();
  await other.getByRole("button", { name: "Bands" }).click();
  await other.locator(".legend .ticks", { hasText: "≥ 0.0500" }).waitFor();
  await other.getByRole("button", { name: "99 %" }).click();
  await other.waitForFunction(() => !location.hash.includes("range=0,0.05"));
  await other.getByRole("button", { name: "All", exact: true }).click();
  await other.waitForFunction(() => !location.hash.includes("range="));
  await other.getByRole("button", { name: "B from A, too" }).click();
  await other.locator("#deviation th", { hasText: "B from A" }).waitFor();
  await finish(page);
  await finish(other);
});

test("a search of distances over A tells how far it is, and can be stopped", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.low}&b=${ids.high}&quads=bilinear`);
  await waitForView(page);
  await page.getByRole("button", { name: "Map the distances" }).click();
  const line = page.locator(".searching", { hasText: /Searching, [\d.]+ s/ });
  await line.waitFor();
  await line.getByRole("button", { name: "Stop" }).click();
  await page.locator("#deviation", { hasText: "stopped before its end" }).waitFor();
  await finish(page);
});

test("intervals are written with the digits that are known, and hold what they stand for", async () => {
  const { intervals } = await import("../../clients/dashboard/core/format.js");
  assert.deepEqual(intervals([{ lower: 0.00031172, upper: 0.00032992 }]), ["3.208 ± 0.092 e-4"]);
  assert.deepEqual(intervals([{ lower: 0.06310890, upper: 0.06311150 }, { lower: -0.25, upper: -0.25 }], 0.01), ["0.06311 ± 0.00001", "-0.25"]);
  assert.deepEqual(intervals([{ lower: 0.5, upper: 0.5 }, { lower: 0, upper: 0.001 }]), ["0.5", "0.00050 ± 0.00050"]);
  const random = chance(7);
  for (let n = 0; n < 5000; n++) {
    const lower = random() * 10 ** (12 * random() - 8);
    const upper = lower + random() * 10 ** (-9 * random()) * lower;
    const [middle, half, power] = intervals([{ lower, upper }])[0].match(/^([\d.]+) ± ([\d.]+)(?: e(-?\d+))?$/).slice(1).map((text) => Number(text ?? 0));
    const slack = 1e-13 * upper;
    assert((middle - half) * 10 ** power <= lower + slack && (middle + half) * 10 ** power >= upper - slack, `seed 7: ${lower} ${upper}`);
  }
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

test("both ways in one table, and the worst places as pins in a list that flies to each; a link brings them back", async () => {
  const [square, hill] = await uploadHill();
  const page = await browser.open(`${daemon.url}/#compare?a=${hill}&b=${square}&limit=0.1`, { viewport: { width: 1300, height: 900 } });
  await waitForView(page);
  await page.getByRole("button", { name: "Compare both ways" }).click();
  await page.locator("#comparison").waitFor();
  const row = (name) => page.locator("#comparison tr", { hasText: name }).locator("td").allInnerTexts();
  // The top of the hill is 0.3 above the square; of the square the farthest point is somewhere beside that.
  const [both, there] = await row("Maximum");
  assert.equal(both, there);
  assert(Math.abs(Number(both.split(" ")[0]) - 0.3) < 1e-6, both);
  assert.match((await row("Share within 0.1")).join(), /^,\d+\.\d( to \d+\.\d)? %,\d+\.\d( to \d+\.\d)? %$/);
  const places = page.getByRole("list", { name: "Worst places" }).getByRole("button");
  const count = await places.count();
  assert(count >= 5 && count <= 10, `${count} places`);
  const values = (await places.allInnerTexts()).map((text) => Number(/: ([\d.]+)/.exec(text)[1]));
  assert(Math.abs(values[0] - 0.3) < 1e-6 && values.every((value, place) => place === 0 || value <= values[place - 1] + 1e-3), values.join());
  await page.locator(".pin").nth(count - 1).waitFor({ state: "attached" }); // they come after the list
  assert.equal(await page.locator(".pin").count(), count);
  const same = await daemon.client().meshes.create(off(moved(sphere(), [0.2, 0, 0])), { name: "moved.off" });
  const twin = await browser.open(`${daemon.url}/#compare?a=${ids.a}&b=${same.mesh.id}`);
  await twin.getByRole("button", { name: "Compare both ways" }).click();
  await twin.locator("#comparison").waitFor();
  const firsts = await twin.getByRole("list", { name: "Worst places" }).getByRole("button").allInnerTexts();
  assert(firsts.length > 1 && firsts.length < 10, "places that lie side by side on both are listed once");
  await finish(twin);

  const [report] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Report, HTML" }).click()]);
  assert.equal(report.suggestedFilename(), "report.html");
  const html = readFileSync(await report.path(), "utf8");
  for (const words of ["<!DOCTYPE html>", "hill_0.off", "hill_1.off", "0.1"]) assert(html.includes(words), words);

  const target = () => page.evaluate(async () => {
    const { eye: { controls }, frame, pair } = (await import("/dashboard/view/view.js")).currentStage();
    return { target: controls.target.toArray().map((x, k) => x / frame.scale + frame.centre[k]), from: pair.from.toArray().map((x, k) => x / frame.scale + frame.centre[k]) };
  });
  await fly(page, () => places.first().click());
  assert.equal(await places.first().getAttribute("aria-pressed"), "true");
  const { target: at, from } = await target();
  assert(Math.hypot(from[0] - 0.5, from[1] - 0.5, from[2] - 0.3) < 1e-6, from.join());
  assert(Math.hypot(at[0] - 0.5, at[1] - 0.5) < 1e-3 && at[2] > 0 && at[2] < 0.3001, at.join());
  await fly(page, () => page.locator(".pin").nth(1).click());
  assert(Math.hypot(...(await target()).from.map((x, k) => x - from[k])) > 0.05, "another place, apart by the radius");

  const other = await browser.open(page.url());
  await other.locator("#comparison").waitFor();
  await other.locator(".pin").nth(count - 1).waitFor({ state: "attached" });
  assert.equal(await other.locator(".pin").count(), count);
  assert.equal(await other.locator("#comparison").innerText(), await page.locator("#comparison").innerText());
  await finish(page);
  await finish(other);
});

test("a section takes a part away, draws the curves of the cut, and is in the link; what is taken away is not met", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.a}&b=${ids.b}`, { viewport: { width: 1300, height: 900 } });
  await waitForView(page);
  const whole = await drawnShare(page);
  await page.locator(".stage-tools").getByRole("button", { name: "Section" }).click();
  await page.getByLabel("Axis of the section").selectOption("z");
  await page.getByLabel("Place of the section").fill("0.25");
  const curves = () => page.evaluate(async () => {
    const stage = (await import("/dashboard/view/view.js")).currentStage();
    await stage.rest();
    const { position } = stage.overlay.group.children[0]?.geometry.attributes ?? {};
    return { count: position?.count ?? 0, heights: Array.from({ length: position?.count ?? 0 }, (_, n) => position.getZ(n)), at: stage.plane?.at };
  });
  await page.waitForFunction((view) => view.currentStage().overlay.group.children.length > 0, await viewOf(page));
  await page.waitForFunction(() => location.hash.includes("cut=z,0.25"));
  const { count, heights, at } = await curves();
  assert(count > 6 * 100 && heights.every((z) => Math.abs(z - at) < 1e-5), `${count} corners of ribbons`);
  assert(await drawnShare(page) < 0.9 * whole, "most of the sphere is taken away");
  const met = () => page.evaluate(async () => {
    const stage = (await import("/dashboard/view/view.js")).currentStage();
    const { pick } = await import("/dashboard/view/pick.js");
    stage.eye.fromText("0,0,3,0,0,0");
    stage.drawNow();
    const { scale, centre } = stage.frame;
    return (pick(stage, stage.models.get("a"), stage.canvas.clientWidth / 2 + 40, stage.canvas.clientHeight / 2).point[2] - centre[2]) * scale;
  });
  assert(await met() < at, "a ray from before the section goes on to the far side");
  await page.getByRole("button", { name: "Other side" }).click();
  await page.waitForFunction(() => location.hash.includes("cut=z,0.25,-"));
  await rest(page);
  assert(await met() > at);

  const other = await browser.open(page.url());
  await waitForView(other);
  await other.waitForFunction((view) => view.currentStage().overlay.group.children.length > 0, await viewOf(other));
  assert.equal(await other.getByLabel("Place of the section").inputValue(), "0.25");
  await other.locator(".stage-tools").getByRole("button", { name: "Section" }).click();
  await other.waitForFunction((view) => view.currentStage().overlay.group.children.length === 0, await viewOf(other));
  await finish(page);
  await finish(other);
});
