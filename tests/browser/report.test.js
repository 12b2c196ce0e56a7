// The report of a comparison in Chromium: complete by itself, for everybody, and on paper.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, keepPicture } from "./support/page.js";
import { hills, off, sphere } from "./support/shapes.js";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const NAME = "<img src=x onerror=alert(1)>.off";
const LIMIT = 0.02;
let daemon;
let browser;
let job;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  job = await compare([[sphere(0, 24, 48), NAME], [sphere(0, 12, 24), "coarse.off"]], [0.005, 0.01, 0.02, 0.04]);
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

/** Compares two meshes: [mesh, name] each. */
async function compare(meshes, limits) {
  const client = daemon.client();
  const [a, b] = await Promise.all(meshes.map(async ([mesh, name]) => (await client.meshes.create(off(mesh), { name })).mesh.id));
  const made = await client.jobs.create({ type: "comparison", a, b, limits, worst: { count: 4 } }, { wait: 60 });
  assert.equal(made.state, "succeeded");
  return made;
}

/** The report, with the addresses that its page asked for. */
async function open(options) {
  const asked = [];
  const page = await browser.open("about:blank", options);
  page.on("request", (request) => { if (!request.url().startsWith("data:")) asked.push(request.url()); });
  page.on("dialog", (dialog) => page.faults.push(dialog.message()));
  const url = `${daemon.url}/v1/jobs/${job.id}/report?limit=${LIMIT}`;
  await page.goto(url);
  return { page, asked, url };
}

test("the client reads the report", async () => {
  const text = await daemon.client().jobs.report(job.id, { limit: LIMIT });
  assert.match(text, /^<!DOCTYPE html>/);
  assert.match(text, /Beyond the limit of 0\.02/);
  assert.doesNotMatch(await daemon.client().jobs.report(job.id), /Beyond/);
});

test("it asks for nothing, runs nothing, and every picture is drawn", async () => {
  const { page, asked, url } = await open();
  assert.deepEqual(asked, [url]);
  assert.equal(await page.locator("script").count(), 0);
  assert.match(await page.locator("h1").innerText(), /^<img src=x onerror=alert\(1\)>\.off \(A\) against coarse\.off \(B\)$/);
  const pictures = await page.locator("svg image").all();
  assert(pictures.length >= 12 + 2);
  for (const picture of pictures) {
    const { width, height } = await picture.boundingBox();
    assert(width > 50 && height > 50);
    assert(await picture.evaluate(async (image) => {
      const loaded = new Image();
      loaded.src = image.getAttribute("href");
      await loaded.decode();
      return loaded.naturalWidth === image.width.baseVal.value;
    }));
  }
  await finish(page);
});

for (const colorScheme of ["light", "dark"]) {
  for (const viewport of [{ width: 1200, height: 900 }, { width: 360, height: 700 }]) {
    test(`everybody can read it, ${colorScheme}, ${viewport.width} wide`, async () => {
      const { page } = await open({ colorScheme, viewport, bypassCSP: true });
      await page.evaluate(AXE);
      const found = await page.evaluate(async () => {
        const { violations } = await globalThis.axe.run(document, { resultTypes: ["violations"] });
        return violations.map(({ id, impact, nodes }) => `${impact} ${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
      });
      assert.deepEqual(found, []);
      const { scroll, client } = await page.evaluate(() => ({ scroll: document.documentElement.scrollWidth, client: document.documentElement.clientWidth }));
      assert(scroll <= client, `${scroll} wide in ${client}`);
      await finish(page);
    });
  }
}

test("it prints on A4 and on Letter", async () => {
  const { page } = await open({ colorScheme: "dark" });
  await page.emulateMedia({ media: "print" });
  assert.equal(await page.evaluate(() => getComputedStyle(document.body).backgroundColor), "rgb(255, 255, 255)");
  for (const kind of ["figure", "tr"])
    assert(await page.locator(kind).evaluateAll((all) => all.every((one) => getComputedStyle(one).breakInside === "avoid")));
  for (const format of ["A4", "Letter"]) {
    const file = (await page.pdf({ format, printBackground: true })).toString("latin1");
    const pages = file.match(/\/Type\s*\/Page[^s]/g).length;
    assert(pages >= 4 && pages <= 10, `${pages} pages of ${format}`);
  }
  await finish(page);
});

test("a report is worth a picture", async () => {
  const limits = Array.from({ length: 16 }, (_, i) => (i + 1) * 0.0025);
  const { id } = await compare([[hills(6), "hills coarse.off"], [hills(32), "hills.off"]], limits);
  const page = await browser.open(`${daemon.url}/v1/jobs/${id}/report?limit=0.02`, { viewport: { width: 1000, height: 1070 } });
  await keepPicture(page, await page.screenshot(), "report");
  await finish(page);
});
