// A Hausdorff distance on its way: the job, its bounds so far, and what became of it.

import { client, noteLoss } from "../core/connection.js";
import { explain } from "../core/messages.js";

/** @import { Bounds, HausdorffRequest, HausdorffResult, Job } from "../../js/types.js" */

export class Measurement {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Job | null} */
    this.job = null;
    /** @type {(Bounds | HausdorffResult)[]} */
    this.samples = [];
    /** @type {HausdorffResult | null} */
    this.result = null;
    /** @type {"idle" | "running" | "lost" | "succeeded" | "canceled" | "failed"} */
    this.stage = "idle";
    this.words = "";
    this.reader = new AbortController();
  }

  get isRunning() {
    return this.stage === "running" || this.stage === "lost";
  }

  /** Asks, and follows the answer to its end. @param {HausdorffRequest} request */
  async ask(request) {
    this.start();
    try {
      await this.follow(await client.jobs.create(request, { signal: this.reader.signal }));
    } catch (error) {
      this.fail(error);
    }
  }

  /** Follows a job from its first event on. @param {string} id @returns {Promise<Job | null>} the job, as soon as known */
  async open(id) {
    this.start();
    try {
      const job = await client.jobs.get(id, { signal: this.reader.signal });
      this.follow(job).catch((error) => this.fail(error));
      return job;
    } catch (error) {
      this.fail(error);
      return null;
    }
  }

  start() {
    this.clear();
    this.reader = new AbortController();
    Object.assign(this, { stage: "running", words: "Asking" });
    this.onChange();
  }

  /** What was measured holds no more. */
  clear() {
    this.leave();
    Object.assign(this, { job: null, samples: [], result: null, stage: "idle", words: "" });
    this.onChange();
  }

  /** @param {Job} job */
  async follow(job) {
    const { signal } = this.reader;
    this.job = job;
    this.words = job.state === "queued" ? "Waiting for its turn" : "Searching";
    this.onChange();
    const onBreak = (/** @type {Error} */ error) => {
      noteLoss(error);
      this.stage = "lost";
      this.words = "The connection is lost; the search goes on when the daemon is back";
      this.onChange();
    };
    const onOpen = () => { this.stage = "running"; };
    for await (const event of client.jobs.events(job.id, { signal, onBreak, onOpen })) {
      if (event.event === "bounds") {
        // A daemon that was restarted searches from the beginning; bounds that were proven still hold.
        const last = this.samples.at(-1);
        if (last && event.elapsed_ms < last.elapsed_ms) this.samples = [];
        this.samples.push(event);
        this.words = "Searching";
      } else if (event.event === "result") {
        this.result = /** @type {HausdorffResult} */ (event.result);
        this.samples.push(this.result);
        this.stage = event.state;
        this.words = ending(this.result);
      } else if (event.event === "error") {
        this.stage = event.state;
        this.words = event.problem.detail;
      }
      this.onChange();
    }
  }

  /** @param {unknown} error */
  fail(error) {
    if (this.reader.signal.aborted) return;
    noteLoss(error);
    const { words, details } = explain(error);
    this.stage = "failed";
    this.words = [words, ...details].join("; ");
    this.onChange();
  }

  async stop() {
    if (this.job) await client.jobs.cancel(this.job.id);
  }

  /** Looks away; the job goes on. */
  leave() {
    this.reader.abort();
  }
}

/** @param {HausdorffResult} result */
function ending({ stopped_by, converged }) {
  if (stopped_by === "limit") return "Stopped: the side of the limit is certain";
  if (converged) return "Done: the gap is as small as asked for";
  const reasons = /** @type {Record<string, string>} */ ({
    canceled: "Stopped; the bounds hold", deadline: "Stopped at the deadline; the bounds hold",
    precision: "Stopped: double precision proves no more; the bounds hold",
    work: "Stopped: the surfaces need too many parts; the bounds hold",
    memory: "Stopped: out of memory for the search; the bounds hold" });
  return reasons[stopped_by] ?? stopped_by;
}
