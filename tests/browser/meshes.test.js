// The page of meshes: upload, list, facts, download, deletion, faults, the 3D view.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
import { Browser, drawnShare, finish, rest, upload, waitForView } from "./support/page.js";
import { box, off, ply, sphere, torusPoints } from "./support/shapes.js";

let daemon;
let browser;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

const fact = (page, name) => page.locator(".figures > div", { has: page.locator(`dt:text-is("${name}")`) }).locator("dd").innerText();

test("an empty daemon says what to do; a first mesh is listed, drawn and described", async () => {
  const page = await browser.open(daemon.url);
  await page.getByText("There is no mesh yet").waitFor();
  await page.getByText("Drop a mesh file on the page").waitFor();
  await upload(page, { name: "box.off", content: off(box()) });
  await waitForView(page);
  assert(await drawnShare(page) > 0.1);
  assert.equal(await fact(page, "Quads"), "384");
  assert.equal(await fact(page, "Irregular vertices"), "8");
  assert.equal(await fact(page, "Regular patches"), String((await daemon.client().meshes.list().next()).value.patches));
  assert.equal(await fact(page, "Box"), "1 × 1 × 1");
  await page.locator("img.thumbnail").waitFor();
  await finish(page);
});

test("files may be dropped anywhere, several at once", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".mesh").first().waitFor();
  const files = await page.evaluateHandle((texts) => {
    const transfer = new DataTransfer();
    for (const [name, text] of texts) transfer.items.add(new File([text], name));
    return transfer;
  }, [["drop_a.off", off(sphere(0, 10, 20))], ["drop_b.off", off(sphere(0.1, 10, 20))]]);
  await page.dispatchEvent("body", "dragover", { dataTransfer: files });
  await page.locator(".drop.over").waitFor();
  await page.dispatchEvent("body", "drop", { dataTransfer: files });
  for (const name of ["drop_a.off", "drop_b.off"]) await page.locator(".meshes .name", { hasText: name }).waitFor();
  await finish(page);
});

test("the error of a faulty file names its line", async () => {
  const page = await browser.open(daemon.url);
  await page.locator("#files").setInputFiles({ name: "bad.obj", mimeType: "", buffer: Buffer.from("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n") });
  const message = page.locator(".message.is-fault");
  await message.waitFor();
  assert.match(await message.innerText(), /bad\.obj: face refers to vertex 4[\s\S]*line 4/);
  await message.getByRole("button").click();
  await message.waitFor({ state: "detached" });
  await finish(page);
});

test("every tool changes the picture, and quads can be read as bilinear patches", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".meshes .name", { hasText: "box.off" }).click();
  await waitForView(page);
  const picture = async () => {
    await rest(page);
    return page.evaluate(() => document.querySelector(".canvas canvas").toDataURL());
  };
  let last = await picture();
  for (const name of ["Edges", "Patches", "Irregular"]) {
    await page.locator(".stage-tools").getByRole("button", { name }).click();
    const next = await picture();
    assert(next !== last, name);
    last = next;
  }
  await page.locator(".stage-tools").getByRole("button", { name: "Bilinear" }).click();
  await waitForView(page);
  assert(await drawnShare(page) > 0.1);
  await page.locator(".canvas canvas").focus();
  last = await picture();
  for (const key of ["ArrowLeft", "ArrowDown", "+"]) {
    await page.keyboard.press(key);
    const next = await picture();
    assert(next !== last, key);
    last = next;
  }
  await finish(page);
});

test("points are drawn as discs with a size", async () => {
  const page = await browser.open(daemon.url);
  await upload(page, { name: "torus.ply", content: ply(torusPoints(20000)) });
  await waitForView(page);
  assert.equal(await fact(page, "Points"), "20,000");
  const few = await drawnShare(page);
  await page.getByLabel("Size of the points").fill("3");
  await rest(page);
  const many = await drawnShare(page);
  assert(few > 0.02 && many > few, `${few} ${many}`);
  await finish(page);
});

test("a mesh is downloaded in every format, and deleted", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".meshes .name", { hasText: "box.off" }).click();
  for (const format of ["obj", "ply", "stl", "off", "glb", "drc"]) {
    await page.getByLabel("Format of the download").selectOption(format);
    const [file] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Download" }).click()]);
    assert.equal(file.suggestedFilename(), `box.${format}`);
    const bytes = readFileSync(await file.path());
    const { mesh } = await daemon.client().meshes.create(bytes, { name: `again.${format}`, format });
    assert.equal(mesh.faces.quads * 2 + mesh.faces.triangles, 768, format);
    await daemon.client().meshes.delete(mesh.id);
  }
  await page.getByRole("button", { name: "Delete" }).click();
  await page.getByRole("button", { name: "Delete for good" }).click();
  await page.locator(".meshes .name", { hasText: "box.off" }).waitFor({ state: "detached" });
  await finish(page);
});
