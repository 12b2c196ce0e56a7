// The page of jobs; a daemon that goes away and comes back; a daemon that wants a token.

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";

import { Daemon } from "./support/daemon.js";
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

test("a stream is taken up again when the daemon is back", () => withDaemon([], async (daemon) => {
  const { a, b } = await slowRequest(daemon.client());
  const page = await browser.open(`${daemon.url}/#compare?a=${a}&b=${b}&quads=bilinear&tolerance=1e-12`);
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
  await page.getByRole("link", { name: "Collide" }).click(); // a view that was not fetched yet
  await page.getByText("it will be when the daemon is back").waitFor();
  await daemon.start();
  await page.locator(".connection.open").waitFor();
  await page.getByRole("button", { name: "Find collisions" }).waitFor();
  page.faults = page.faults.filter((fault) => !fault.includes("ERR_"));
  await finish(page);
}));
