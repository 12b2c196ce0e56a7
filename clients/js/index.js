// A client of quadmeshd for browsers and Node 18 on:
//
//   const client = new Client({ base: "http://127.0.0.1:7878" });
//   const { mesh } = await client.meshes.create(file, { name: "part.ply" });
//   const job = await client.jobs.create({ type: "hausdorff", a: mesh.id, b: other.id });
//   for await (const event of client.jobs.events(job.id)) console.log(event);
//
// Refusals are thrown as ProblemError, lost connections as ConnectionError. Every call takes an AbortSignal.

import { Jobs } from "./jobs.js";
import { Layouts } from "./layouts.js";
import { Meshes } from "./meshes.js";
import { Reconstructions } from "./reconstructions.js";
import { System } from "./system.js";
import { Transport } from "./transport.js";

export class Client {
  /**
   * @param {{ base?: string, token?: string | null, fetch?: typeof fetch }} [options] base: the daemon's address, in a
   *   page that it served itself none; token: a bearer token, kept in memory only
   */
  constructor(options = {}) {
    this.transport = new Transport(options);
    this.meshes = new Meshes(this.transport);
    this.jobs = new Jobs(this.transport);
    this.layouts = new Layouts(this.transport);
    this.reconstructions = new Reconstructions(this.transport);
    this.system = new System(this.transport);
  }

  /** @param {string | null} token */
  set token(token) {
    this.transport.token = token;
  }
}

export { ConnectionError, ProblemError } from "./problem.js";
export { FOOT_WIDTH } from "./meshes.js";
