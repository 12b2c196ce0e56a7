// The page of meshes: upload, list, facts, download, deletion, faults, the 3D view.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";

import { Daemon, until } from "./support/daemon.js";
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

test("area, volume and topology are told; unit and uncertainty can be set; the shape of the faces is a table and a histogram", async () => {
  const client = daemon.client();
  const { mesh } = await client.meshes.create(off(box(4)), { name: "unit cube.off" });
  const page = await browser.open(`${daemon.url}/#meshes?mesh=${mesh.id}`, { viewport: { width: 1300, height: 900 } });
  await page.locator("#facts-title", { hasText: "unit cube.off" }).waitFor();
  assert.match(await fact(page, "Area"), /^6(\.0+ ± 0\.0*1)?$/);
  assert.match(await fact(page, "Volume"), /^1(\.0+ ± 0\.0*1)?$/);
  for (const [name, value] of [["Watertight", "yes"], ["Winding agrees", "yes"], ["Genus", "0"], ["Euler number", "2"], ["Degenerate faces", "0"], ["Duplicate faces", "0"]]) {
    assert.equal(await fact(page, name), value, name);
  }
  await page.locator("select[name=unit]").selectOption("mm");
  await until(async () => (await client.meshes.get(mesh.id)).unit === "mm", "the unit");
  await page.waitForFunction(() => [...document.querySelectorAll(".figures dd")].some((value) => value.textContent.endsWith(" mm³")));
  await page.locator("input[name=uncertainty]").fill("0.02");
  await page.locator("input[name=uncertainty]").press("Tab");
  await until(async () => (await client.meshes.get(mesh.id)).uncertainty === 0.02, "the uncertainty");
  await page.locator("input[name=uncertainty]").fill("-1");
  await page.locator("input[name=uncertainty]").press("Tab");
  await page.locator(".message.is-fault", { hasText: "0 or more" }).waitFor();

  await page.getByRole("button", { name: "Shape of the faces" }).click();
  const row = page.locator("#quality tr", { hasText: "scaled jacobian" });
  await row.waitFor();
  assert.deepEqual(await row.locator("td").allInnerTexts(), ["1.000", "1.000", "1.000"]);
  await page.getByRole("button", { name: "warpage" }).click();
  await page.locator('#quality canvas[aria-label*="warpage"]').waitFor();
  assert.equal(await page.getByRole("button", { name: "warpage" }).getAttribute("aria-pressed"), "true");
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

test("Fit shows all from where one is", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".meshes .name", { hasText: "box.off" }).first().click();
  await waitForView(page);
  const side = () => page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().eye.side.toArray());
  await page.locator(".canvas canvas").focus();
  for (const key of ["ArrowLeft", "ArrowLeft", "ArrowDown", "+", "+"]) await page.keyboard.press(key);
  const before = await side();
  await page.locator(".stage-tools").getByRole("button", { name: "Fit" }).click();
  (await side()).forEach((value, k) => assert(Math.abs(value - before[k]) < 1e-6));
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

test("a mesh is downloaded in every format", async () => {
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
  await finish(page);
});

test("a deleted mesh is gone at once, comes back by Undo, and is deleted when the time for that is over", async () => {
  const client = daemon.client();
  const { mesh } = await client.meshes.create(off(box(3)), { name: "gone.off" });
  const page = await browser.open(`${daemon.url}/#meshes?mesh=${mesh.id}`);
  const name = page.locator(".meshes .name", { hasText: "gone.off" });
  await name.waitFor();
  await page.locator("h2", { hasText: "gone.off" }).waitFor();
  const remove = async () => {
    await page.getByRole("button", { name: "Delete" }).click();
    await name.waitFor({ state: "detached" });
  };
  await remove();
  assert.equal((await client.meshes.get(mesh.id)).name, "gone.off");
  await page.getByRole("link", { name: "Jobs" }).click(); // Undo goes along
  await page.locator(".message", { hasText: "gone.off is deleted" }).getByRole("button", { name: "Undo" }).click();
  await page.getByRole("link", { name: "Meshes" }).click();
  await name.click();
  await page.locator("h2", { hasText: "gone.off" }).waitFor();
  await remove();
  await until(() => client.meshes.get(mesh.id).then(() => false, (error) => error.status === 404), "the deletion");
  await finish(page);
});

test("a sample pair is a click away, and is compared", async () => {
  const page = await browser.open(daemon.url);
  assert.equal(await page.getByRole("link", { name: "the API" }).getAttribute("href"), "/docs");
  await page.getByRole("button", { name: "Coarse quads and a fine surface" }).click();
  await page.locator('body[data-page="compare"]').waitFor();
  await page.locator(".legend", { hasText: "coarse quads.obj from fine surface.obj" }).waitFor();
  await page.getByRole("link", { name: "Meshes" }).click();
  await page.getByRole("button", { name: "A part and what it should be" }).click();
  await page.locator(".legend", { hasText: "part.obj from design.obj" }).waitFor();
  const most = await page.locator("#deviation tr", { hasText: "Maximum" }).locator("td").innerText();
  assert(Number(most.split(" ")[0]) > 0.05, most);
  await finish(page);
});

test("a file that is dropped on a view that was opened by its address is uploaded, with its progress", async () => {
  for (const view of ["compare", "sketch", "jobs"]) {
    const page = await browser.open(`${daemon.url}/#${view}`);
    await page.locator(`body[data-page="${view}"]`).waitFor();
    const rows = page.evaluate(() => new Promise((resolve) => {
      new MutationObserver(() => resolve(document.querySelector("#uploads").textContent)).observe(document.querySelector("#uploads"), { childList: true });
    }));
    const isPrevented = await page.evaluate((text) => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([text], "dropped.off"));
      return ["dragover", "drop"].map((name) => !document.body.dispatchEvent(new DragEvent(name, { dataTransfer, bubbles: true, cancelable: true })));
    }, off(box(2)));
    assert.deepEqual(isPrevented, [true, true]);
    assert.match(await rows, /dropped\.off/);
    await page.locator(".message", { hasText: "dropped.off is here" }).waitFor();
    await finish(page);
  }
});

test("a mesh that somebody else uploads appears by itself", async () => {
  const page = await browser.open(daemon.url);
  await page.locator(".mesh").first().waitFor();
  await daemon.client().meshes.create(off(box(5)), { name: "from elsewhere.off" });
  await page.locator(".meshes .name", { hasText: "from elsewhere.off" }).waitFor();
  await finish(page);
});

test("a long list is narrowed by name, and what is known of a mesh stays at hand", async () => {
  for (let n = 0; n < 12; n++) await daemon.client().meshes.create(off(box(2)), { name: `step ${n}.off` });
  const page = await browser.open(daemon.url, { viewport: { width: 1300, height: 900 } });
  await page.locator(".meshes .name", { hasText: "step 11.off" }).waitFor();
  const place = await page.getByRole("button", { name: "Download" }).boundingBox();
  assert(place.y < 2 * 900, `${place.y} px down`);
  await page.getByPlaceholder("Part of a name").fill("STEP 7");
  await page.locator(".mesh").nth(1).waitFor({ state: "detached" });
  assert.equal(await page.locator(".meshes .name").innerText(), "step 7.off");
  await page.getByPlaceholder("Part of a name").fill("no such name");
  await page.getByText("No name has this in it").waitFor();
  await finish(page);
});
