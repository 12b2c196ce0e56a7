// A browser with the daemon's page in it. Every test fails on an error that the page did not expect.

import assert from "node:assert/strict";
import { mkdirSync, writeFileSync } from "node:fs";
import path from "node:path";

import { chromium } from "playwright-core";

import { ROOT } from "./daemon.js";

const PATIENCE_MS = 60000;

export class Browser {
  static async launch() {
    const browser = new Browser();
    browser.process = await chromium.launch({
      executablePath: process.env.QM_CHROMIUM ?? "/usr/bin/chromium",
      // Root may only run it without its sandbox; SwiftShader draws where there is no graphics card. What lies around the 3D
      // view is put together without it, which takes a fifth of the time less.
      args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
        "--disable-gpu-compositing"],
    });
    return browser;
  }

  /**
   * A page of its own, with what it complained of in `page.faults`.
   * @param {string} url
   * @param {import("playwright-core").BrowserContextOptions} [options]
   */
  async open(url, options = {}) {
    const context = await this.process.newContext({ viewport: { width: 900, height: 620 }, acceptDownloads: true, ...options });
    const page = await context.newPage();
    page.setDefaultTimeout(PATIENCE_MS);
    page.faults = [];
    page.on("pageerror", (error) => page.faults.push(error.stack ?? String(error)));
    page.on("console", (message) => {
      // The page shows a refused request; the console logs it as well.
      const isExpected = message.text().startsWith("Failed to load resource") || message.text().includes("GPU stall");
      if (["error", "warning"].includes(message.type()) && !isExpected) page.faults.push(message.text());
    });
    await page.goto(url);
    return page;
  }

  close() {
    return this.process.close();
  }
}

/** Ends a page that has nothing to complain of. */
export async function finish(page) {
  assert.deepEqual(page.faults, []);
  await page.context().close();
}

/** Chooses files in the page's input: { name, content } each. */
export async function upload(page, ...files) {
  await page.locator("#files").setInputFiles(files.map(({ name, content }) => ({
    name, mimeType: "application/octet-stream", buffer: Buffer.from(content) })));
  for (const { name } of files) await page.locator(".meshes .name", { hasText: name }).waitFor();
}

/** Waits until the view has drawn the present state. */
export function rest(page) {
  return page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage()?.rest());
}

/** The page's module of the view, for conditions of waitForFunction: it takes a promise for a condition that is met, so that they cannot
 * import it themselves. */
export const viewOf = (page) => page.evaluateHandle(() => import("/dashboard/view/view.js"));

/** Does something that has the view fly to a place, and waits until it has arrived. @param {() => Promise<unknown>} act */
export async function fly(page, act) {
  await page.evaluate(async () => {
    const { eye } = (await import("/dashboard/view/view.js")).currentStage();
    window.hasFlown = false;
    eye.flyTo = (...way) => { // for one flight, in the place of that of its class
      delete eye.flyTo;
      eye.flyTo(...way);
      window.hasFlown = true;
    };
  });
  await act();
  await page.waitForFunction((view) => window.hasFlown && view.currentStage().eye.flight === 0, await viewOf(page));
  await rest(page);
}

/** Waits for the view to hold a whole mesh, and to have drawn it. */
export async function waitForView(page) {
  await page.waitForFunction(() => document.querySelector(".canvas canvas") !== null
    && document.getElementById("stage-progress").textContent === "" && document.getElementById("stage-empty").hidden);
  await rest(page);
}

/** Keeps a picture of a page in build/pictures, to be looked at. QM_PICTURES names a folder that gets a small one for the README. */
export async function keepPicture(page, png, name) {
  assert(png.length > 20000, name);
  const folder = path.join(ROOT, "build/pictures");
  mkdirSync(folder, { recursive: true });
  writeFileSync(path.join(folder, `${name}.png`), png);
  if (!process.env.QM_PICTURES) return;
  const webp = await page.evaluate(async (text) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))]));
    const canvas = new OffscreenCanvas(image.width, image.height);
    canvas.getContext("2d").drawImage(image, 0, 0);
    const bytes = new Uint8Array(await (await canvas.convertToBlob({ type: "image/webp", quality: 0.85 })).arrayBuffer());
    return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
  }, png.toString("base64"));
  writeFileSync(path.join(process.env.QM_PICTURES, `${name}.webp`), Buffer.from(webp, "base64"));
}

/** How much of the view has another colour than its corner: 0 when nothing is drawn. */
export function drawnShare(page) {
  return page.evaluate(() => {
    const canvas = document.querySelector(".canvas canvas");
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [200, 120];
    const context = copy.getContext("2d");
    context.drawImage(canvas, 0, 0, 200, 120);
    const { data } = context.getImageData(0, 0, 200, 120);
    let other = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (Math.abs(data[i] - data[0]) + Math.abs(data[i + 1] - data[1]) + Math.abs(data[i + 2] - data[2]) > 24) other++;
    }
    return other / (data.length / 4);
  });
}
