// Refines a reconstruction step by step, so that each step can be seen, until a goal is reached or it is told to stop.

import { client, noteLoss } from "../core/connection.js";

/** @import { Job, StepResult } from "../../js/types.js" */
/** @typedef {{ max_quads?: number, hausdorff_relative?: number }} Goal */

export class Runner {
  /** @param {(result: StepResult) => Promise<unknown>} onStep called after each step */
  constructor(onStep) {
    this.onStep = onStep;
    /** @type {Job | null} */
    this.job = null;
    this.isStopped = false;
  }

  /**
   * @param {string} reconstruction
   * @param {number} most steps at most
   * @param {Goal} goal
   * @returns {Promise<StepResult["stopped_by"]>}
   */
  async run(reconstruction, most, goal) {
    this.isStopped = false;
    for (let step = 0; step < most && !this.isStopped; step++) {
      const until = Object.keys(goal).length > 0 ? goal : undefined;
      this.job = await client.jobs.create({ type: "reconstruction_step", reconstruction, steps: 1, until });
      const result = await this.follow(this.job);
      await this.onStep(result);
      if (result.stopped_by !== "steps") return result.stopped_by;
    }
    return this.isStopped ? "canceled" : "steps";
  }

  /** @param {Job} job */
  async follow(job) {
    for await (const event of client.jobs.events(job.id, { onBreak: noteLoss })) {
      if (event.event === "error") throw new Error(event.problem.detail);
      if (event.event === "result") return /** @type {StepResult} */ (event.result);
    }
    throw new Error("the job ended without a result");
  }

  async stop() {
    this.isStopped = true;
    if (this.job) await client.jobs.cancel(this.job.id).catch(() => {}); // it has just ended by itself
  }
}
