// The jobs of the daemon, the newest first and some at a time: what is shown is kept fresh, the rest is not read.

import { client, noteLoss } from "../core/connection.js";
import { sayFault } from "../core/messages.js";
import { state } from "../core/state.js";

/** @import { Job } from "../../js/types.js" */
/** @typedef {{ state: string, type: string, mesh: string, label: string }} Filter "": all */

const PAGE = 25;
const OPEN_MS = 1500;
const IDLE_MS = 5000;

/** @param {Job} job */
export const isOpen = (job) => job.state === "queued" || job.state === "running";

export class History {
  /** @param {Filter} filter @param {() => void} onChange */
  constructor(filter, onChange) {
    this.filter = filter;
    this.onChange = onChange;
    /** The newest first. @type {Job[]} */
    this.jobs = [];
    this.isRead = false;
    this.hasMore = false;
    this.reader = new AbortController();
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.start();
  }

  /** Reads from the newest one on. */
  start() {
    this.reader.abort();
    this.reader = new AbortController();
    clearTimeout(this.timer);
    this.older = this.list(PAGE);
    Object.assign(this, { jobs: [], isRead: false, hasMore: false });
    return this.more().then(() => this.plan());
  }

  /** @param {number} pageSize */
  list(pageSize) {
    const chosen = Object.fromEntries(Object.entries(this.filter).filter(([, value]) => value !== ""));
    return client.jobs.list({ order: "newest", pageSize, ...chosen, signal: this.reader.signal });
  }

  /** Older ones. */
  async more() {
    const { older } = this;
    await this.safely(async () => {
      /** @type {Job[]} */
      const found = [];
      let isEnd = false;
      while (found.length < PAGE && !isEnd) {
        const next = await /** @type {NonNullable<typeof older>} */ (older).next();
        if (next.done) isEnd = true;
        else found.push(next.value);
      }
      if (older !== this.older) return;
      const known = new Set(this.jobs.map(({ id }) => id));
      this.jobs = [...this.jobs, ...found.filter(({ id }) => !known.has(id))];
      this.hasMore = !isEnd;
      this.isRead = true;
      this.onChange();
    });
  }

  /** Reads new ones, and those again that had not ended. */
  async refresh() {
    await this.safely(async () => {
      const list = this.list(PAGE);
      /** @type {Job[]} */
      const newest = [];
      const known = new Map(this.jobs.map((job) => [job.id, job]));
      let meets = this.jobs.length === 0;
      for await (const job of list) {
        meets ||= known.has(job.id);
        newest.push(job);
        if (newest.length === PAGE) break;
      }
      if (!meets && newest.length === PAGE) return void this.start(); // more came than a page
      const fresh = new Map(newest.map((job) => [job.id, job]));
      for (const job of this.jobs) if (isOpen(job) && !fresh.has(job.id)) fresh.set(job.id, await client.jobs.get(job.id, { signal: this.reader.signal }));
      const added = newest.filter(({ id }) => !known.has(id));
      this.jobs = [...added, ...this.jobs.map((job) => fresh.get(job.id) ?? job)].filter(({ state: now }) => this.filter.state === "" || this.filter.state === now);
      this.onChange();
    });
  }

  /** @param {() => Promise<void>} action */
  async safely(action) {
    const { signal } = this.reader;
    try {
      await action();
    } catch (error) {
      if (signal.aborted) return;
      noteLoss(error);
      if (state.connection === "open") sayFault(error);
    }
  }

  plan() {
    const { signal } = this.reader;
    if (signal.aborted) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(async () => {
      if (state.connection === "open" && document.visibilityState === "visible") await (this.isRead ? this.refresh() : this.more());
      if (!signal.aborted) this.plan();
    }, this.jobs.some(isOpen) ? OPEN_MS : IDLE_MS);
  }

  leave() {
    this.reader.abort();
    clearTimeout(this.timer);
  }
}
