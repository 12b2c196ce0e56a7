// The page of jobs; a daemon that goes away and comes back; a daemon that wants a token.

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";

import { Daemon, until } from "./support/daemon.js";
import { Browser, finish, upload, waitForView } from "./support/page.js";
import { SLOW, box, heaps, off } from "./support/shapes.js";

let browser;
before(async () => { browser = await Browser.launch(); });
after(() => browser.close());

async function withDaemon(settings, action) {
  const daemon = await Daemon.start(...settings);
  try {
    await action(daemon);
  } finally {
    await daemon.remove();
  }
}

async function slowRequest(client) {
  const [a, b] = await Promise.all(heaps().map(async (heap, i) =>
    (await client.meshes.create(off(heap), { name: `heap ${i}` })).mesh.id));
  return { type: "hausdorff", a, b, ...SLOW };
}

test("jobs are listed with their state, canceled, and shown again", () => withDaemon(["--workers", "1"], async (daemon) => {
  const client = daemon.client();
  const page = await browser.open(`${daemon.url}/#jobs`);
  await page.getByText("No jobs yet").waitFor();
  const request = await slowRequest(client);
  const first = await client.jobs.create(request);
  const follower = await client.jobs.create(request); // shares the events and the result of the first one
  const second = await client.jobs.create({ ...request, direction: "a_to_b" });
  await page.locator(".state.running").nth(2).waitFor();
  assert.equal(await page.locator("h2").innerText(), "Jobs, 3 open");
  assert.match(await page.locator("tbody tr").first().innerText(), /A to B, bilinear/); // the newest first
  for (let count = 0; count < 3; count++) {
    await page.locator("tr", { has: page.locator(".running") }).first().getByRole("button", { name: /Cancel/ }).click();
    await page.locator(".state.canceled").nth(count).waitFor();
  }
  for (const job of [first, follower, second])
    assert.equal((await client.jobs.get(job.id)).state, "canceled");
  await page.locator("tbody tr").last().getByRole("link").click();
  await page.locator("#outcome", { hasText: "Stopped; the bounds hold" }).waitFor();
  assert.equal(await page.locator("select[name=quads]").inputValue(), "bilinear");
  await finish(page);
}));

test("the history is read a page at a time, filtered by kind and state, looked into and deleted", () => withDaemon([], async (daemon) => {
  const client = daemon.client();
  const [a, b] = await Promise.all([box(2), box(3)].map(async (mesh, place) => (await client.meshes.create(off(mesh), { name: `box_${place}` })).mesh.id));
  for (let n = 0; n < 70; n++) await client.jobs.create({ type: "project", mesh: a, points: [[n, 0, 0]] }, { wait: 10 });
  for (let n = 0; n < 3; n++) await client.jobs.create({ type: "hausdorff", a, b, gap: 10 ** (-3 - n) }, { wait: 10 });
  const page = await browser.open("about:blank");
  let read = 0;
  page.on("response", async (response) => {
    if (new URL(response.url()).pathname === "/v1/jobs") read += (await response.json()).jobs.length;
  });
  await page.goto(`${daemon.url}/#jobs`);
  await page.locator("tbody tr").nth(24).waitFor();
  await page.waitForTimeout(6000); // it is looked at again meanwhile
  assert(read <= 3 * 25, `${read} jobs were read`);
  assert.equal(await page.locator("tbody tr").count(), 25);
  const [first] = await page.locator("tbody tr").elementHandles();
  await page.getByRole("button", { name: "Older jobs" }).click();
  await page.locator("tbody tr").nth(49).waitFor();
  assert(await first.evaluate((row) => row.isConnected), "rows that are the same stay");

  await page.locator("select[name=type]").selectOption("hausdorff");
  await page.locator("tbody tr").nth(3).waitFor({ state: "detached" });
  assert.equal(await page.locator("tbody tr", { hasText: "Hausdorff distance" }).count(), 3);
  assert(page.url().includes("type=hausdorff"));
  await page.getByRole("button", { name: /^Details/ }).first().click();
  await page.locator("dialog pre", { hasText: '"gap": 0.00001' }).first().waitFor();
  await page.getByRole("button", { name: "Close" }).click();
  const remove = () => page.getByRole("button", { name: /^Delete the record/ }).first().click();
  await remove();
  await page.locator("tbody tr").nth(2).waitFor({ state: "detached" });
  await page.getByRole("button", { name: "Undo" }).click();
  await page.locator("tbody tr").nth(2).waitFor();
  await remove();
  const count = async () => {
    let number = 0;
    for await (const job of client.jobs.list({ type: "hausdorff" })) if (job) number++;
    return number;
  };
  await until(async () => (await count()) === 2, "the deletion");
  await page.locator("select[name=state]").selectOption("failed");
  await page.getByText("There are no such jobs").waitFor();
  await finish(page);
}));

test("a stream is taken up again when the daemon is back", () => withDaemon([], async (daemon) => {
  const { a, b } = await slowRequest(daemon.client());
  const page = await browser.open(`${daemon.url}/#compare?a=${a}&b=${b}&quads=bilinear&gap=1e-12`);
  await page.getByRole("button", { name: "Measure" }).click();
  await page.waitForFunction(() => document.querySelector("#upper .value").textContent !== "–");
  await daemon.stop("SIGKILL");
  await page.locator(".connection.lost").waitFor();
  await page.locator("#outcome", { hasText: "the search goes on when the daemon is back" }).waitFor();
  await daemon.start();
  await page.locator(".connection.open").waitFor();
  await page.locator("#outcome", { hasText: "Searching" }).waitFor();
  await page.getByRole("button", { name: "Stop" }).click();
  await page.locator("#outcome", { hasText: "Stopped; the bounds hold" }).waitFor();
  page.faults = page.faults.filter((fault) => !fault.includes("ERR_"));
  await finish(page);
}));

test("a page asks for a token, refuses a wrong one, and keeps it in memory only", () => withDaemon([], async (plain) => {
  const token = "w".repeat(20);
  const file = path.join(plain.folder, "tokens");
  writeFileSync(file, `write ${token}\n`, { mode: 0o600 });
  await withDaemon(["--token-file", file], async (daemon) => {
    const page = await browser.open(daemon.url);
    const enter = async (words) => {
      await page.getByLabel("Bearer token").fill(words);
      await page.getByRole("button", { name: "Use it" }).click();
    };
    await page.getByLabel("Bearer token").waitFor();
    await page.keyboard.press("Escape");
    await page.getByText("The daemon wants a token").waitFor();
    await page.getByRole("button", { name: "Token", exact: true }).click();
    await enter("wrong".repeat(5));
    await page.getByText("the token is not valid").waitFor();
    await enter(token);
    await page.getByText("There is no mesh yet").waitFor();
    await upload(page, { name: "box.off", content: off(box()) });
    await waitForView(page); // its worker has the token too
    const kept = await page.evaluate(() => JSON.stringify([{ ...localStorage }, { ...sessionStorage }, document.cookie, location.href]));
    assert(!kept.includes(token));
    await page.reload();
    await page.getByLabel("Bearer token").waitFor();
    await finish(page);
  });
}));

test("a daemon that went away is found again", () => withDaemon([], async (daemon) => {
  const page = await browser.open(`${daemon.url}/#jobs`);
  await page.locator(".connection.open").waitFor();
  await daemon.stop();
  await page.locator(".connection.lost").waitFor();
  await page.evaluate(() => { // two views that were not fetched yet, the first left at once
    location.hash = "#sketch";
    location.hash = "#collide";
  });
  await page.getByText("The view “Collide” could not be fetched; it will be when the daemon is back").waitFor();
  assert.equal(await page.getByText("it will be when the daemon is back").count(), 1);
  await daemon.start();
  await page.locator(".connection.open").waitFor();
  await page.getByRole("button", { name: "Find collisions" }).waitFor();
  page.faults = page.faults.filter((fault) => !fault.includes("ERR_"));
  await finish(page);
}));
