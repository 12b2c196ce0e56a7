// A real daemon: started on a free port, stopped with SIGTERM, its log searched for findings.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtempSync, openSync, closeSync, readFileSync, rmSync, existsSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { fileURLToPath } from "node:url";

import { Client } from "../../../clients/js/index.js";

export const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../../..");
export const BUILD = path.join(ROOT, process.env.QM_BUILD ?? "build");
const FINDINGS = ["ERROR: AddressSanitizer", "ERROR: LeakSanitizer", "WARNING: ThreadSanitizer", "runtime error:"];
const PATIENCE_MS = 60000;

export class Daemon {
  /** @param {string[]} settings of the command line */
  static async start(...settings) {
    const daemon = new Daemon(mkdtempSync(path.join(tmpdir(), "qm-browser-")), settings);
    await daemon.start();
    return daemon;
  }

  constructor(folder, settings) {
    this.folder = folder;
    this.settings = settings;
    this.port = 0;
  }

  /** Starts the process; after stop, again on the same port and data. */
  async start() {
    const portFile = path.join(this.folder, "port");
    rmSync(portFile, { force: true });
    const log = openSync(path.join(this.folder, "log"), "a");
    this.process = spawn(path.join(BUILD, "quadmeshd"), [
      "--port", String(this.port), "--port-file", portFile, "--data-dir", path.join(this.folder, "data"),
      ...this.settings], { stdio: ["ignore", log, log] });
    closeSync(log);
    this.ended = new Promise((resolve) => { this.process.on("exit", resolve); });
    const end = Date.now() + PATIENCE_MS;
    while (!(await this.isReady(portFile))) {
      assert.equal(this.process.exitCode, null, `the daemon ended at once:\n${this.log()}`);
      assert(Date.now() < end, `the daemon is not ready:\n${this.log()}`);
      await sleep(20);
    }
  }

  async isReady(portFile) {
    const text = existsSync(portFile) ? readFileSync(portFile, "utf8") : "";
    if (!text.endsWith("\n")) return false;
    this.port = Number(text);
    this.url = `http://127.0.0.1:${this.port}`;
    return fetch(`${this.url}/readyz`).then((reply) => reply.ok, () => false);
  }

  log() {
    return readFileSync(path.join(this.folder, "log"), "utf8");
  }

  client(options = {}) {
    return new Client({ base: this.url, ...options });
  }

  /** Ends the process, by SIGTERM cleanly and without findings. */
  async stop(how = "SIGTERM") {
    this.process.kill(how);
    const status = await this.ended;
    const log = this.log();
    assert(!FINDINGS.some((finding) => log.includes(finding)), log);
    if (how === "SIGTERM") assert.equal(status, 0, log);
  }

  /** Ends it for good. */
  async remove() {
    await this.stop();
    rmSync(this.folder, { recursive: true });
  }
}

/** Waits until check() is true. */
export async function until(check, what) {
  const end = Date.now() + PATIENCE_MS;
  while (!(await check())) {
    assert(Date.now() < end, `waited too long for ${what}`);
    await sleep(20);
  }
}
