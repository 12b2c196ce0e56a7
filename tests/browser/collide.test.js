// The pages that find collisions and deform.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon, until } from "./support/daemon.js";
import { Browser, finish, waitForView } from "./support/page.js";
import { ball, box, moved, off } from "./support/shapes.js";

let daemon;
let browser;
let ids;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ids = {};
  for (const [name, mesh] of Object.entries({ one: box(4), near: moved(box(4), [0.75, 0.3, 0.3]), far: moved(box(4), [3, 0, 0]), ball: ball(16) })) {
    ids[name] = (await daemon.client().meshes.create(off(mesh), { name })).mesh.id;
  }
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

test("contacts are counted, stepped through and flown to; apart, the least distance is shown", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.one}&b=${ids.near}`);
  await waitForView(page);
  await page.getByRole("button", { name: "Find collisions" }).click();
  const job = await daemon.client().jobs.create({ type: "collision", a: ids.one, b: ids.near }, { wait: 30 });
  await page.locator("#collisions", { hasText: `${job.result.count} pairs of faces meet` }).waitFor();
  const contact = page.locator("#contact");
  await page.waitForFunction(() => document.querySelector("#contact").textContent.startsWith("1 of"));
  const [first] = job.result.pairs;
  assert.match(await contact.innerText(), new RegExp(`^1 of ${job.result.count}: faces ${first.faces[0]} and ${first.faces[1]}`));
  await page.getByRole("button", { name: "Next contact" }).click();
  await page.waitForFunction(() => document.querySelector("#contact").textContent.startsWith("2 of"));
  await page.getByRole("button", { name: "Previous contact" }).click();
  await page.getByRole("button", { name: "Previous contact" }).click();
  await page.waitForFunction((count) => document.querySelector("#contact").textContent.startsWith(`${count} of`), job.result.count);

  await page.locator("select[name=b]").selectOption(ids.far);
  await page.getByRole("button", { name: "Find collisions" }).click();
  await page.locator("#collisions", { hasText: "The two do not meet" }).waitFor();
  await page.getByText(/^(2\.000000|1\.999999) to 2\.00000/).waitFor();
  await page.locator("select[name=b]").selectOption("");
  await page.getByRole("button", { name: "Find collisions" }).click();
  await page.locator("#collisions", { hasText: "No faces meet that should not" }).waitFor();
  await finish(page);
});

test("a dragged region refits, folds are found as they come, and can be undone", async () => {
  const page = await browser.open(`${daemon.url}/#deform?a=${ids.ball}`);
  await waitForView(page);
  /** That of the copy that the first drag makes; what was uploaded stays. */
  const copy = () => new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("a");
  const revision = async () => (await daemon.client().meshes.get(copy())).revision;
  await page.getByRole("button", { name: "Take the middle of the view" }).click();
  await page.locator("#folds", { hasText: "The handle is taken" }).waitFor();
  await page.getByRole("button", { name: "Pull out" }).click();
  await page.locator("#folds", { hasText: "No faces meet" }).waitFor();
  assert.notEqual(copy(), ids.ball);
  assert.equal((await daemon.client().meshes.get(copy())).name, "ball, deformed");
  assert.equal(await revision(), 1);
  await page.getByRole("link", { name: "Jobs" }).click(); // Undo outlives the view
  await page.locator('body[data-page="jobs"]').waitFor();
  await page.getByRole("link", { name: "Deform" }).click();
  await waitForView(page);
  await page.getByRole("button", { name: "Undo" }).click();
  await page.locator("#folds", { hasText: "undone" }).waitFor();
  await waitForView(page);

  const view = await page.locator(".canvas canvas").boundingBox();
  const [x, y] = [view.x + view.width / 2, view.y + view.height / 2];
  await page.waitForTimeout(300);
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (const share of [0.3, 0.6, 1]) await page.mouse.move(x + share * 100, y + share * 30);
  await page.mouse.up();
  await page.locator("#folds", { hasText: "No faces meet" }).waitFor();
  assert(await revision() > 2);
  // In through the ball, and out of its other side.
  await page.getByRole("button", { name: "Take the middle of the view" }).click();
  await page.locator("#folds", { hasText: "The handle is taken" }).waitFor();
  for (let step = 0; step < 24; step++) await page.getByRole("button", { name: "Push in" }).click();
  await page.locator("#folds.fault", { hasText: "of faces meet" }).waitFor();
  await until(async () => (await page.locator(".figures dd").first().innerText()) === String(await revision()), "the last revision");
  const job = await daemon.client().jobs.create({ type: "self_collision", mesh: copy() }, { wait: 30 });
  await until(async () => (await page.locator("#folds").innerText()).startsWith(job.result.count.toLocaleString("en")), "the last round");
  assert.equal((await daemon.client().meshes.get(ids.ball)).revision, 0);
  await finish(page);
});
