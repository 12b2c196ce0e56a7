// How the page copes with large meshes, on this machine: node tests/browser/bench.js [RUNS]
//
// Of a real daemon (QM_BUILD, the release build by default) and Chromium: from the start of the page to its first view in
// use; for 400,000 triangles and 1,000,000 points from the click to the first and the last piece on the screen, and the
// longest task of the page's thread meanwhile, by the clock and by what the processor did for it: on a busy machine the first
// is mostly waiting. Medians of the runs. Nothing is asserted.

import { Daemon } from "./support/daemon.js";
import { Browser, waitForView } from "./support/page.js";
import { ply, sheet, torusPoints } from "./support/shapes.js";

const runs = Number(process.argv[2] ?? 3);
const MESHES = [["400,000 triangles", sheet(500, 400)], ["1,000,000 points", torusPoints(1000000)]];

const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];

function watchTasks() {
  globalThis.tasks = [];
  new PerformanceObserver((list) => globalThis.tasks.push(...list.getEntries().map(({ startTime, duration }) => ({ startTime, duration }))))
    .observe({ type: "longtask", buffered: true });
}

/** The longest task of the page's thread in processor time, in ms. @param {Buffer} trace */
function longestWork(trace) {
  const { traceEvents: events } = JSON.parse(trace);
  const place = ({ pid, tid }) => `${pid} ${tid}`;
  const mains = new Set(events.filter(({ name, args }) => name === "thread_name" && args.name === "CrRendererMain").map(place));
  return Math.max(0, ...events.filter((event) => event.name === "RunTask" && event.ph === "X" && mains.has(place(event))).map(({ tdur }) => (tdur ?? 0) / 1000));
}

async function measure(page, name) {
  await browser.process.startTracing(page, { categories: ["toplevel", "devtools.timeline", "disabled-by-default-devtools.timeline"] });
  await page.evaluate((words) => {
    globalThis.tasks.length = 0;
    globalThis.begun = performance.now();
    const words2 = document.getElementById("stage-progress");
    globalThis.first = 0;
    new MutationObserver(() => { if (!globalThis.first && /[1-9]\d* %/.test(words2.textContent)) globalThis.first = performance.now(); })
      .observe(words2, { childList: true });
    [...document.querySelectorAll(".meshes .name")].find((button) => button.textContent === words).click();
  }, name);
  await page.waitForTimeout(50);
  await waitForView(page);
  const whole = await page.evaluate(() => performance.now() - globalThis.begun);
  await page.waitForTimeout(500);
  const work = longestWork(await browser.process.stopTracing());
  return page.evaluate(([end, busy]) => ({
    work: busy, first: globalThis.first - globalThis.begun, whole: end, longest: Math.max(0, ...globalThis.tasks.map(({ duration }) => duration)),
  }), [whole, work]);
}

const daemon = await Daemon.start();
const browser = await Browser.launch();
const results = { start: [] };
for (let run = 0; run < runs; run++) {
  const page = await browser.open("about:blank");
  await page.addInitScript(watchTasks);
  await page.goto(daemon.url);
  await page.locator(".connection.open").waitFor();
  await page.locator("#files").waitFor();
  results.start.push(await page.evaluate(() => performance.now()));
  await page.context().close();
}
for (const [name, mesh] of MESHES) await daemon.client().meshes.create(ply(mesh), { name });
await daemon.client().meshes.create("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", { name: "small" });
for (let run = 0; run < runs; run++) {
  const page = await browser.open("about:blank");
  await page.addInitScript(watchTasks);
  await page.goto(daemon.url);
  await waitForView(page);
  for (const [name] of MESHES) (results[name] ??= []).push(await measure(page, name));
  await page.context().close();
}
console.log(`first view in use after ${median(results.start).toFixed(0)} ms`);
for (const [name] of MESHES) {
  const of = (member) => median(results[name].map((result) => result[member])).toFixed(0);
  console.log(`${name}: first piece ${of("first")} ms, whole ${of("whole")} ms, longest task ${of("longest")} ms, of work ${of("work")} ms`);
}
await browser.close();
await daemon.remove();
