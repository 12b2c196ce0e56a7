// Labels of meshes and jobs, and lists that are narrowed to names, labels, states and kinds, by the daemon's own filters.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon, until } from "./support/daemon.js";
import { Browser, finish } from "./support/page.js";
import { box, moved, off } from "./support/shapes.js";

let daemon;
let browser;
let client;
let ids;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  client = daemon.client();
  ids = [];
  for (let n = 0; n < 8; n++) {
    const labels = n % 2 === 0 ? ["even", `lot-${n % 4}`] : [];
    ids.push((await client.meshes.create(off(moved(box(1), [n, 0, 0])), { name: `part ${n}.off`, labels })).mesh.id);
  }
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

async function idsOf(list) {
  const found = [];
  for await (const { id } of list) found.push(id);
  return found;
}
const labelsOf = async (id) => (await client.meshes.get(id)).labels;

test("meshes show their labels, which are edited, and are listed by label and name; a link has the list", async () => {
  const page = await browser.open(`${daemon.url}/#meshes?mesh=${ids[1]}`, { viewport: { width: 1200, height: 800 } });
  const names = () => page.locator(".meshes .name").allInnerTexts();
  await page.locator(".mesh", { hasText: "even, lot-2" }).first().waitFor();
  const asked = [];
  page.on("request", (request) => { if (request.url().includes("label=")) asked.push(new URL(request.url()).searchParams.get("label")); });
  await page.locator(".section select[name=label]").selectOption("lot-2");
  await page.locator(".mesh").nth(2).waitFor({ state: "detached" });
  assert.deepEqual(asked, ["lot-2"], "the daemon lists them");
  const wanted = await idsOf(client.meshes.list({ label: "lot-2" }));
  assert.deepEqual(wanted, [ids[2], ids[6]]);
  assert.deepEqual(await names(), ["part 6.off", "part 2.off"]);
  await page.locator("input[name=filter]").fill("PART 2");
  assert.deepEqual(await names(), ["part 2.off"]);
  assert(page.url().includes("label=lot-2") && page.url().includes("name=PART+2"), page.url());
  const other = await browser.open(page.url());
  await other.locator(".mesh .name", { hasText: "part 2.off" }).waitFor();
  assert.equal(await other.locator(".mesh").count(), 1);
  await finish(other);

  // One more with the label is in the list as soon as it has it.
  await page.locator("input[name=filter]").fill("");
  const labels = page.locator("input[name=labels]");
  await page.locator("#facts-title", { hasText: "part 1.off" }).waitFor();
  await labels.fill("lot-2, new  third");
  await labels.press("Tab");
  await page.locator(".mesh", { hasText: "part 1.off" }).waitFor();
  assert.deepEqual(await labelsOf(ids[1]), ["lot-2", "new", "third"]);
  await page.waitForFunction(() => document.querySelector("input[name=labels]").value === "lot-2, new, third");
  await labels.fill("no<such>label");
  await labels.press("Tab");
  await page.locator(".message.is-fault").waitFor();
  await page.waitForFunction(() => document.querySelector("input[name=labels]").value === "lot-2, new, third");
  await labels.fill("");
  await labels.press("Tab");
  await until(async () => (await labelsOf(ids[1])).length === 0, "no labels");
  await page.locator(".mesh", { hasText: "part 1.off" }).waitFor({ state: "detached" });
  await finish(page);
});

test("jobs are listed by mesh, label, kind and state, and their labels are edited", async () => {
  const ask = (a, b, type, labels) => client.jobs.create({ type, a: ids[a], b: ids[b], labels }, { wait: 20 }).then(({ id }) => id);
  const jobs = [await ask(0, 1, "hausdorff", ["nightly"]), await ask(0, 2, "distance", ["nightly", "gate"]), await ask(2, 1, "hausdorff", [])];
  const page = await browser.open(`${daemon.url}/#jobs`, { viewport: { width: 1300, height: 800 } });
  const rows = page.locator("tbody tr");
  await rows.nth(2).waitFor();
  await page.locator("input[name=label]").fill("nightly");
  await page.locator("input[name=label]").press("Enter");
  await rows.nth(2).waitFor({ state: "detached" });
  assert.match((await rows.allInnerTexts()).join("\n"), /Least distance · nightly, gate[\s\S]*Hausdorff distance · nightly/);
  await page.locator("select[name=mesh]").selectOption(ids[2]);
  await rows.nth(1).waitFor({ state: "detached" });
  assert.match(await rows.first().innerText(), /part 0\.off → part 2\.off/);
  assert.deepEqual(await idsOf(client.jobs.list({ mesh: ids[2], label: "nightly" })), [jobs[1]]);
  const other = await browser.open(page.url());
  await other.locator("tbody tr", { hasText: "gate" }).waitFor();
  assert.equal(await other.locator("tbody tr").count(), 1);
  await finish(other);
  await page.locator("input[name=label]").fill("");
  await page.locator("input[name=label]").press("Enter");
  await rows.nth(1).waitFor();
  await page.locator("select[name=type]").selectOption("hausdorff");
  await rows.nth(1).waitFor({ state: "detached" });
  await page.getByRole("button", { name: /^Details/ }).click();
  await page.locator("dialog input[name=labels]").fill("seen");
  await page.locator("dialog input[name=labels]").press("Tab");
  await until(async () => (await client.jobs.get(jobs[2])).labels.join() === "seen", "the label");
  await page.getByRole("button", { name: "Close" }).click();
  await rows.filter({ hasText: "Hausdorff distance · seen" }).waitFor();
  await page.locator("select[name=state]").selectOption("failed");
  await page.getByText("There are no such jobs").waitFor();
  await finish(page);
});
