// A job that is asked for and followed to its end, with what is known of it meanwhile, and a button that stops it.

import { ProblemError } from "../js/index.js";
import { client, noteLoss } from "./connection.js";
import { h } from "./dom.js";
import { duration, length } from "./format.js";
import { run } from "./messages.js";

/** @import { Bounds, Job, JobRequest, JobResult } from "../../js/types.js" */

const TICK_MS = 250;

/** @typedef {{ id: string, result: JobResult, isStopped: boolean }} Found isStopped: before its end; what it has holds */

export class Search {
  /** @param {(bounds: Bounds) => string} [describe] what is known so far, in words */
  constructor(describe = describeBounds) {
    this.describe = describe;
    /** @type {Job | null} */
    this.job = null;
    /** @type {Bounds | null} */
    this.bounds = null;
    this.reader = new AbortController();
    this.start = 0;
    this.words = h("span", { className: "muted number" });
    this.stopper = h("button", { type: "button", onclick: () => run(() => this.stop()) }, "Stop");
    /** What the page shows of it while it runs. */
    this.element = h("div", { className: "row searching", hidden: true }, h("progress", { "aria-label": "Searching" }), this.words, this.stopper);
  }

  get isRunning() {
    return !this.element.hidden;
  }

  /**
   * Asks a question and follows it; the one before is left to itself.
   * @param {JobRequest} request
   * @returns {Promise<Found>} rejects with AbortError when something newer was asked for, or the view was left
   */
  run(request) {
    return this.track((signal) => client.jobs.create(request, { signal }));
  }

  /** Follows a job that was asked for before. @param {string} id @returns {Promise<Found>} */
  open(id) {
    return this.track((signal) => client.jobs.get(id, { signal }));
  }

  /** @param {(signal: AbortSignal) => Promise<Job>} start @returns {Promise<Found>} */
  async track(start) {
    this.leave();
    const { signal } = this.reader = new AbortController();
    Object.assign(this, { job: null, bounds: null, start: performance.now() });
    const timer = setInterval(() => this.draw(), TICK_MS);
    this.stopper.disabled = false;
    this.element.hidden = false;
    this.draw();
    try {
      const job = this.job = await start(signal);
      return await this.follow(job.id, signal);
    } finally {
      clearInterval(timer);
      if (!signal.aborted) this.element.hidden = true;
    }
  }

  /** @param {string} id @param {AbortSignal} signal @returns {Promise<Found>} */
  async follow(id, signal) {
    for await (const event of client.jobs.events(id, { signal, onBreak: noteLoss })) {
      if (event.event === "bounds") this.bounds = event;
      if (event.event === "error") throw new ProblemError(event.problem);
      if (event.event === "result") return { id, result: event.result, isStopped: event.state === "canceled" };
    }
    throw new Error("the job ended without a result");
  }

  draw() {
    const known = this.bounds ? `; ${this.describe(this.bounds)}` : "";
    this.words.textContent = `${this.stopper.disabled ? "Stopping" : "Searching"}, ${duration(performance.now() - this.start)}${known}`;
  }

  /** Ends the search with what it has. */
  async stop() {
    if (!this.job) return;
    this.stopper.disabled = true;
    this.draw();
    await client.jobs.cancel(this.job.id);
  }

  /** Looks away; the job goes on. */
  leave() {
    this.reader.abort();
    this.element.hidden = true;
  }
}

/** Of a search for the greatest distance beside other figures. @param {Bounds} bounds */
export const describeMaximum = ({ lower, upper }) => `maximum ${length(lower, 3)} to ${upper === null ? "∞" : length(upper, 3)}`;

/** @param {Bounds} bounds */
const describeBounds = ({ lower, upper }) => `${length(lower, 3)} to ${upper === null ? "∞" : length(upper, 3)} so far`;
