// The page for everybody: axe-core on every view, dark and light, narrow and large; by keyboard alone; its policy and weight.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, fly, waitForView } from "./support/page.js";
import { SPHERE_TURN, moved, off, roundedBox, roundedBoxLayout, sphere } from "./support/shapes.js";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
let daemon;
let browser;
let ids;
let box;
let beside;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ids = [];
  for (const turn of [0, SPHERE_TURN]) {
    ids.push((await daemon.client().meshes.create(off(sphere(turn, 10, 20)), { name: `sphere_${turn.toFixed(2)}.off` })).mesh.id);
  }
  await daemon.client().jobs.create({ type: "hausdorff", a: ids[0], b: ids[1] }, { wait: 30 });
  box = (await daemon.client().meshes.create(off(roundedBox(12)), { name: "box.off", labels: ["lot-7"] })).mesh.id;
  beside = (await daemon.client().meshes.create(off(moved(roundedBox(6), [0.6, 0.2, 0.1])), { name: "beside.off" })).mesh.id;
  // One curve too few: something is missing of it, and four patches are whole.
  const { nodes, curves } = roundedBoxLayout();
  const layout = await daemon.client().layouts.create({ mesh: box, nodes, curves: curves.slice(1) });
  const grown = await daemon.client().reconstructions.create({ layout: layout.id });
  await daemon.client().jobs.create({ type: "reconstruction_step", reconstruction: grown.id, steps: 2 }, { wait: 30 });
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

async function violations(page) {
  await page.evaluate(AXE); // the page's policy does not hold for the browser's driver
  return page.evaluate(async () => {
    const found = await globalThis.axe.run(document, { resultTypes: ["violations"] });
    return found.violations.map(({ id, impact, nodes }) => `${impact} ${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
  });
}

/** What is done in each view before it is looked at. */
const VIEWS = {
  meshes: {
    hash: () => `#meshes?mesh=${box}`, act: async (page) => {
      await waitForView(page);
      await page.getByRole("button", { name: "Shape of the faces" }).click();
      await page.locator("#quality canvas").waitFor();
    } },
  compare: {
    hash: () => `#compare?a=${ids[0]}&b=${ids[1]}&limit=0.0001&signed=1`, act: async (page) => {
      await page.getByRole("button", { name: "Measure" }).click();
      await page.locator("#outcome", { hasText: "the side of the limit is certain" }).waitFor();
      await page.getByRole("button", { name: "Compare both ways" }).click();
      await page.locator(".pin").first().waitFor({ state: "attached" });
      await page.getByRole("button", { name: "By landmarks" }).click();
      await page.locator("#landmarks", { hasText: "Click a place of A" }).waitFor();
      await page.getByRole("button", { name: "Map the distances" }).click();
      await page.locator("#deviation").waitFor();
      await page.locator(".range").getByRole("button", { name: "Bands" }).click();
      await page.getByRole("button", { name: "By the normals" }).click(); // the link's sign is refused
      await page.locator("#signed tr", { hasText: "Share from" }).waitFor();
      await page.getByRole("button", { name: "Align A onto B" }).click();
      await page.locator("#reach:not([hidden])").waitFor();
      await page.getByRole("button", { name: "Map the distances" }).click();
      await page.locator("#deviation").waitFor();
      await page.locator(".stage-tools").getByRole("button", { name: "Section" }).click();
    } },
  collide: {
    hash: () => `#collide?a=${box}&b=${beside}&limit=0.1`, act: async (page) => {
      await page.getByRole("button", { name: "Find collisions" }).click();
      await page.locator("#contact").waitFor();
      await page.locator("#penetration td").first().waitFor();
      await page.locator("#clearance:not([hidden])").waitFor();
    } },
  deform: { hash: () => `#deform?a=${ids[0]}`, act: waitForView },
  sketch: { hash: () => `#sketch?a=${box}`, act: (page) => page.locator(".issues li").first().waitFor() },
  remesh: { hash: () => `#remesh?a=${box}`, act: (page) => page.locator("tbody tr").nth(1).waitFor() },
  jobs: { hash: () => "#jobs", act: (page) => page.locator("tbody tr").nth(3).waitFor() },
};

/** Looks at the page in both themes. */
async function look(page, what) {
  for (let theme = 0; theme < 2; theme++) {
    assert.deepEqual(await violations(page), [], what);
    await page.evaluate(() => document.getElementById("theme").click()); // also where a dialog lies over it
  }
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  assert(overflow <= 0, `${what} is ${overflow} px too wide`);
}

for (const width of [1300, 320]) {
  test(`no view and no dialog has a violation, light and dark, ${width} px wide`, async () => {
    const page = await browser.open(`${daemon.url}/#jobs`, { viewport: { width, height: 740 }, reducedMotion: "reduce" }); // colours that fade have other contrasts
    await page.locator(".connection.open").waitFor();
    for (const [view, { hash, act }] of Object.entries(VIEWS)) {
      await page.evaluate((to) => { location.hash = to; }, hash());
      await page.locator(`body[data-page="${view}"]`).waitFor();
      await act(page);
      await look(page, view);
    }
    await page.getByRole("button", { name: /^Details/ }).first().click();
    await page.locator("dialog pre").first().waitFor();
    await look(page, "the details of a job");
    await page.keyboard.press("Escape");
    await page.locator("dialog").waitFor({ state: "detached" });
    await page.getByRole("button", { name: "Token" }).click();
    await page.locator("#token-input").fill("secret");
    await look(page, "the dialog for the token");
    await page.getByRole("button", { name: "Cancel" }).click();
    await page.getByRole("button", { name: /^Delete the record/ }).first().click();
    await page.getByRole("button", { name: "Undo" }).waitFor();
    await look(page, "a message");
    await page.getByRole("button", { name: "Undo" }).click();
    await page.locator("input[name=label]").fill("none-such");
    await page.locator("input[name=label]").press("Enter");
    await page.getByText("There are no such jobs").waitFor();
    await look(page, "an empty list");
    await finish(page);
  });
}

test("two meshes are compared by keyboard alone", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".mesh").first().waitFor();
  const press = async (name, key = "Enter") => {
    for (let tabs = 0; tabs < 60; tabs++) {
      await page.keyboard.press("Tab");
      const label = await page.evaluate(() => {
        const element = document.activeElement;
        return element === document.body ? "" : element.getAttribute("aria-label") ?? element.textContent;
      });
      if (label !== name) continue;
      await page.keyboard.press(key);
      return;
    }
    assert.fail(`Tab does not reach ${name}`);
  };
  await press("sphere_0.00.off as A of the comparison");
  await press("sphere_0.03.off as B of the comparison");
  await press("Compare");
  await waitForView(page);
  await page.getByRole("button", { name: "Measure", exact: true, disabled: false }).waitFor();
  await fly(page, () => press("Measure"));
  await page.locator("#outcome", { hasText: "Done" }).waitFor();
  const target = () => page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.controls.target.toArray());
  await page.locator(".canvas canvas").focus();
  const before = await target();
  await page.keyboard.press("Shift+ArrowLeft");
  const moved = await target();
  assert(Math.hypot(...moved.map((x, k) => x - before[k])) > 0.01, "Shift and an arrow move the view");
  await page.keyboard.press("Shift+ArrowRight");
  assert(Math.hypot(...(await target()).map((x, k) => x - before[k])) < 1e-6);
  await finish(page);
});

test("who goes elsewhere while a view is on its way gets there", async () => {
  const page = await browser.open(`${daemon.url}/#jobs`);
  await page.locator('body[data-page="jobs"]').waitFor();
  // The view arrives, and writes its choices into the address, before the page gets the event of the step.
  await page.evaluate(() => {
    location.hash = "#meshes";
    history.replaceState(null, "", "#jobs");
  });
  await page.locator('body[data-page="meshes"]').waitFor();
  assert.match(await page.evaluate(() => location.hash), /^#meshes/);
  await finish(page);
});

test("the page brings its policy, and weighs little without three.js", async () => {
  const reply = await fetch(daemon.url);
  const policy = reply.headers.get("Content-Security-Policy");
  assert.match(policy, /default-src 'self'; script-src 'self' 'sha256-[\w+/=]{44}'/);
  assert(!policy.includes("unsafe"));
  const html = await reply.text();
  assert(!/\son\w+=|style=|<script>/.test(html), "nothing inline");

  const page = await browser.open("about:blank");
  /** @type {Map<string, number>} a worker asks again for what the page has */
  const sizes = new Map();
  let faults = 0;
  page.on("response", (response) => {
    if (response.status() >= 400) faults += 1;
    const { pathname, protocol } = new URL(response.url());
    if (protocol === "http:" && !/^\/(v1|dashboard\/vendor)\//.test(pathname)) sizes.set(pathname, Number(response.headers()["content-length"] ?? 0));
  });
  await page.goto(daemon.url);
  await waitForView(page);
  assert.equal(faults, 0);
  const weight = [...sizes.values()].reduce((sum, size) => sum + size);
  assert(weight > 10000 && weight < 200000, `${weight} bytes`);
  const tag = (await fetch(`${daemon.url}/dashboard/main.js`)).headers.get("ETag");
  assert.equal((await fetch(`${daemon.url}/dashboard/main.js`, { headers: { "If-None-Match": tag } })).status, 304);
  for (const path of ["package.json", "js/../../quadmeshd", "js/none.js"]) {
    assert.equal((await fetch(`${daemon.url}/dashboard/${path}`)).status, 404, path);
  }
  await finish(page);
});
