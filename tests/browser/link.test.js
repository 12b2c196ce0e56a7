// "A link opens the same view again": the address as it is, in a browser that has never seen the page, shows the same picture.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, finish, fly, rest, viewOf, waitForView } from "./support/page.js";
import { ball, box, moved, off } from "./support/shapes.js";

let daemon;
let browser;
let ids;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ids = {};
  const bumpy = { ...ball(8), vertices: ball(8).vertices.map(([x, y, z]) => [x, y, z].map((value) => value * (1 + 0.25 * Math.exp(-8 * ((x - 1) ** 2 + y ** 2 + z ** 2)) + 0.15 * Math.exp(-8 * (x ** 2 + (y - 1) ** 2 + z ** 2))))) };
  for (const [name, mesh] of Object.entries({ bumpy, ball: ball(6), box: box(4), near: moved(box(4), [0.75, 0.3, 0.3]) })) {
    ids[name] = (await daemon.client().meshes.create(off(mesh), { name: `${name}.off` })).mesh.id;
  }
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const VIEWPORT = { viewport: { width: 900, height: 620 } };
const LEAST_ALIKE = 0.998;

/** Waits until the address has the camera of the view, and nothing moves any more. */
async function settle(page) {
  await page.waitForFunction(() => document.querySelectorAll(".searching:not([hidden])").length === 0);
  await rest(page);
  await page.waitForFunction((view) => {
    const { eye } = view.currentStage();
    return eye.flight === 0 && new URLSearchParams(location.hash.split("?")[1]).get("eye") === eye.toText();
  }, await viewOf(page));
  await page.evaluate(() => { document.activeElement?.blur?.(); document.getElementById("messages").replaceChildren(); });
  await page.mouse.move(5, 5);
  await rest(page);
}

/** The share of pixels that are alike in two pictures of the view. */
async function alike(page, one, other) {
  return page.evaluate(async (pictures) => {
    const [a, b] = await Promise.all(pictures.map(async (text) => {
      const image = await createImageBitmap(new Blob([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))]));
      const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
      context.drawImage(image, 0, 0);
      return context.getImageData(0, 0, image.width, image.height).data;
    }));
    let same = 0;
    for (let at = 0; at < a.length; at += 4) same += Number([0, 1, 2].every((k) => Math.abs(a[at + k] - b[at + k]) < 24));
    return same / (a.length / 4);
  }, [one, other].map((png) => png.toString("base64")));
}

/** Opens the address of a page elsewhere, and compares what both show. @param {(page) => Promise<unknown>} arrive waits for what takes time */
async function compare(page, arrive, parts) {
  await settle(page);
  const fresh = await browser.open(page.url(), VIEWPORT);
  await waitForView(fresh);
  await arrive(fresh);
  await settle(fresh);
  const pictures = await Promise.all([page, fresh].map((one) => one.locator("#stage").screenshot()));
  const share = await alike(page, ...pictures);
  assert(share > LEAST_ALIKE, `${share} of the picture is alike at ${page.url()}`);
  for (const part of parts) assert.equal(await fresh.locator(part).innerText(), await page.locator(part).innerText(), part);
  const choices = (of) => [...new URLSearchParams(new URL(of.url()).hash.split("?")[1])].sort();
  assert.deepEqual(choices(fresh), choices(page));
  await finish(fresh);
  return pictures[0];
}

test("Compare: camera, range, bands, sign, selected part, worst place, pins, section and alignment", async () => {
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.bumpy}&b=${ids.ball}`, VIEWPORT);
  await waitForView(page);
  await page.locator("input[name=limit]").fill("0.08");
  await page.getByRole("button", { name: "Align A onto B" }).click();
  await page.locator("#alignment .figures").waitFor();
  await waitForView(page);
  await page.getByRole("button", { name: "Map the distances" }).click();
  await page.locator(".legend").waitFor();
  await page.getByRole("button", { name: "Signed" }).click();
  await page.locator(".legend", { hasText: "sides proven" }).waitFor();
  await page.locator("input[name=high]").fill("0.15");
  await page.locator("input[name=high]").press("Tab");
  await fly(page, () => page.getByRole("list", { name: "Parts beyond the limit" }).getByRole("button").nth(1).click());
  await page.locator(".stage-tools").getByRole("button", { name: "Edges" }).click();
  await page.getByRole("button", { name: "Value in the middle" }).click();
  await page.locator(".pin").waitFor();
  const arrive = async (fresh) => {
    await fresh.locator(".legend", { hasText: "sides proven" }).waitFor();
    await fresh.locator(".pin").first().waitFor({ state: "attached" });
    await fresh.locator('#regions [aria-pressed="true"]').waitFor();
  };
  // How far the colours may be off depends on what was asked before, so that more was cut.
  const ranged = await compare(page, arrive, [".legend-title", ".legend .ticks", "#regions", "#signed", "#alignment", "#reach"]);

  await page.locator(".range").getByRole("button", { name: "Bands" }).click();
  await page.locator("#signed tr", { hasText: "Share from -0.08 to 0.08" }).waitFor();
  await page.locator(".stage-tools").getByRole("button", { name: "Section" }).click();
  await page.getByLabel("Place of the section").fill("0.7");
  await page.getByRole("button", { name: "Compare both ways" }).click();
  await page.locator("#comparison").waitFor();
  await fly(page, () => page.getByRole("list", { name: "Worst places" }).getByRole("button").nth(1).click());
  await page.locator(".stage").focus().catch(() => {});
  const banded = await compare(page, async (fresh) => {
    await fresh.locator("#signed tr", { hasText: "Share from -0.08 to 0.08" }).waitFor();
    await fresh.getByRole("list", { name: "Worst places" }).locator('[aria-pressed="true"]').waitFor();
    await fresh.locator(".legend .band").first().waitFor();
    await fresh.locator(".pin").nth(1).waitFor({ state: "attached" });
  }, [".legend-title", "#signed", "#comparison", "#regions"]);
  assert(await alike(page, ranged, banded) < LEAST_ALIKE, "the two views differ");
  await finish(page);
});

test("Collide: the contact, its normals, the camera; Meshes: the mesh and the camera", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.box}&b=${ids.near}&limit=0.5`, VIEWPORT);
  await waitForView(page);
  await page.getByRole("button", { name: "Find collisions" }).click();
  await page.locator("#relation", { hasText: "reach into" }).waitFor();
  await page.locator("#clearance").waitFor();
  await fly(page, () => page.getByRole("button", { name: "Next contact" }).click());
  await page.locator(".canvas canvas").focus();
  for (const key of ["ArrowLeft", "ArrowUp", "+"]) await page.keyboard.press(key);
  await compare(page, async (fresh) => {
    await fresh.locator("#relation", { hasText: "reach into" }).waitFor();
    await fresh.locator("#clearance").waitFor();
  }, ["#contact", "#normals", "#clearance", "#penetration"]);
  await finish(page);

  const meshes = await browser.open(`${daemon.url}/#meshes?mesh=${ids.bumpy}`, VIEWPORT);
  await waitForView(meshes);
  await meshes.locator(".canvas canvas").focus();
  for (const key of ["ArrowRight", "ArrowRight", "ArrowDown", "-"]) await meshes.keyboard.press(key);
  await compare(meshes, async () => {}, ["#facts-title"]);
  await finish(meshes);
});

test("Jobs: each answer is shown by its view", async () => {
  const client = daemon.client();
  const ask = (request) => client.jobs.create(request, { wait: 60 });
  const { result: aligned } = await ask({ type: "alignment", a: ids.near, b: ids.box, start: "identity" });
  await ask({ type: "collision", a: ids.box, b: ids.near });
  await ask({ type: "distance", a: ids.box, b: ids.near, limit: 0.25 });
  await ask({ type: "deviation", a: ids.bumpy, b: ids.ball, sign: "outside", limit: 0.08, bands: [[null, -0.05], [-0.05, 0.06], [0.06, null]] });
  const page = await browser.open(`${daemon.url}/#jobs?label=`, VIEWPORT);
  const show = async (words) => {
    await page.evaluate(() => { location.hash = "#jobs"; });
    await page.locator("tbody tr", { hasText: words }).first().getByRole("link").click();
  };
  await show("Alignment");
  await page.locator("#alignment .figures").waitFor();
  const pose = new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("pose").split(",").map(Number);
  assert.deepEqual(pose, aligned.transform.filter((_, place) => place % 4 !== 3));
  await show("Collisions");
  await page.waitForFunction(() => document.querySelector("#contact")?.textContent.startsWith("1 of"));
  await show("Least distance");
  await page.locator("#clearance", { hasText: "not above the 0.25 wanted" }).waitFor();
  await show("Deviation");
  await page.locator("#signed tr", { hasText: "Share from -0.05 to 0.06" }).waitFor();
  assert.equal(await page.locator("input[name=limit]").inputValue(), "0.08");
  await finish(page);
});
