// /v1/jobs and /v1/batches: questions about meshes, and their answers.

import { ConnectionError, ProblemError } from "./problem.js";
import { readPages } from "./pages.js";
import { pause, readLines } from "./stream.js";

/** @import { BatchAnswer, Job, JobEvent, JobRequest, JobResult } from "./types.js" */
/** @import { Transport } from "./transport.js" */
/** @typedef {{ signal?: AbortSignal }} Options */

/** @param {string} id */
const pathOf = (id) => `/v1/jobs/${encodeURIComponent(id)}`;
const FIRST_PAUSE_MS = 200;
const LONGEST_PAUSE_MS = 5000;
const STREAM = { Accept: "application/x-ndjson" };

export class Jobs {
  /** @param {Transport} transport */
  constructor(transport) {
    this.transport = transport;
  }

  /**
   * Asks a question.
   * @param {JobRequest} request
   * @param {Options & { wait?: number, fresh?: boolean, idempotencyKey?: string }} [options] wait: seconds to wait for
   *   the end; fresh: not from an earlier answer
   * @returns {Promise<Job>} as it is then
   */
  create(request, { wait, fresh, idempotencyKey, signal } = {}) {
    return this.transport.json("/v1/jobs", {
      method: "POST", body: JSON.stringify(request), signal,
      headers: {
        "Content-Type": "application/json", "Idempotency-Key": idempotencyKey,
        Prefer: wait === undefined ? undefined : `wait=${wait}`, "Cache-Control": fresh ? "no-cache" : undefined,
      },
    });
  }

  /**
   * Asks a question and reads its events over the one connection. A reader who leaves, or a connection that breaks,
   * cancels the job, unless `detach` is true.
   * @param {JobRequest} request
   * @param {Options & { fresh?: boolean }} [options]
   * @returns {AsyncGenerator<JobEvent, void>}
   */
  async *stream(request, { fresh, signal } = {}) {
    const headers = { ...STREAM, "Content-Type": "application/json", "Cache-Control": fresh ? "no-cache" : undefined };
    const body = JSON.stringify(request);
    yield* readEvents(await this.transport.send("/v1/jobs", { method: "POST", headers, body, signal }), signal);
  }

  /**
   * All jobs that pass the filters, in order of creation.
   * @param {Options & { pageSize?: number, order?: "oldest" | "newest", state?: string, type?: string, mesh?: string,
   *   reconstruction?: string, label?: string }} [options]
   * @returns {AsyncGenerator<Job, void>}
   */
  list(options = {}) {
    return readPages(this.transport, "/v1/jobs", "jobs", options);
  }

  /**
   * @param {string} id
   * @param {Options & { wait?: number }} [options] wait: seconds to wait for the end
   * @returns {Promise<Job>}
   */
  get(id, { wait, signal } = {}) {
    return this.transport.json(pathOf(id), { headers: { Prefer: wait === undefined ? undefined : `wait=${wait}` }, signal });
  }

  /**
   * Sets all labels of a job; null is none.
   * @param {string} id
   * @param {{ labels: string[] | null }} change
   * @param {Options} [options]
   * @returns {Promise<Job>}
   */
  change(id, change, { signal } = {}) {
    const headers = { "Content-Type": "application/json" };
    return this.transport.json(pathOf(id), { method: "PATCH", headers, body: JSON.stringify(change), signal });
  }

  /**
   * Tells a job to stop; it ends with what it has. One that has ended already is refused with 409.
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<Job>}
   */
  cancel(id, { signal } = {}) {
    return this.transport.json(pathOf(id), { method: "DELETE", signal });
  }

  /**
   * Removes a job that has ended, with its events and result. One that has not ended is refused with 409.
   * @param {string} id
   * @param {Options} [options]
   */
  async delete(id, { signal } = {}) {
    await this.transport.send(pathOf(id), { method: "DELETE", query: { job: "ended" }, signal });
  }

  /**
   * A job's events, from the first or after one, to the end. A stream that breaks is taken up again where it was, for
   * as long as `signal` lets it, also when the daemon was restarted meanwhile; onBreak is called for each attempt.
   * @param {string} id
   * @param {Options & { after?: number, onBreak?: (error: Error, attempt: number) => void, onOpen?: () => void }} [options]
   * @returns {AsyncGenerator<JobEvent, void>}
   */
  async *events(id, { after = 0, onBreak, onOpen, signal } = {}) {
    for (let attempt = 0; ;) {
      try {
        const response = await this.transport.send(`${pathOf(id)}/events`, { query: { after }, headers: STREAM, signal });
        onOpen?.();
        for await (const event of readEvents(response, signal)) {
          attempt = 0;
          after = event.seq;
          yield event;
        }
        return;
      } catch (error) {
        const passes = error instanceof ConnectionError || (error instanceof ProblemError && error.isTemporary);
        if (!passes) throw error;
        onBreak?.(error, ++attempt);
        await pause(Math.min(FIRST_PAUSE_MS * 2 ** (attempt - 1), LONGEST_PAUSE_MS), signal);
      }
    }
  }

  /**
   * The whole result; that of a deviation with the distances at A's vertices.
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<JobResult>}
   */
  result(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/result`, { signal });
  }

  /**
   * The distances at A's vertices of a deviation, in the order of the file.
   * @param {string} id
   * @param {Options} [options]
   */
  async distances(id, { signal } = {}) {
    const headers = { Accept: "application/octet-stream" };
    return new Float64Array(await this.transport.bytes(`${pathOf(id)}/result`, { headers, signal }));
  }

  /**
   * All pairs of faces of a collision, two numbers each; or of meshes of a matrix, four: two places and two bounds.
   * @param {string} id
   * @param {Options} [options]
   */
  pairs(id, options = {}) {
    return this.distances(id, options);
  }

  /**
   * The result of a comparison as a page of HTML that needs nothing beside itself.
   * @param {string} id
   * @param {Options & { limit?: number, limitIn?: number, limitOut?: number, range?: number }} [options] the permitted distances, and the end
   *   of the colour scale
   * @returns {Promise<string>}
   */
  report(id, { limit, limitIn, limitOut, range, signal } = {}) {
    return this.transport.text(`${pathOf(id)}/report`, { query: { limit, limit_in: limitIn, limit_out: limitOut, range }, headers: { Accept: "text/html" }, signal });
  }

  /**
   * A heat map as a binary PLY file.
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<ArrayBuffer>}
   */
  heatmapFile(id, { signal } = {}) {
    return this.transport.bytes(`${pathOf(id)}/result`, { query: { format: "ply" }, signal });
  }

  /**
   * The triangles of a heat map, fourteen numbers each: x, y, z and distance of each corner, the face, the error.
   * @param {string} id
   * @param {Options} [options]
   */
  triangles(id, options = {}) {
    return this.distances(id, options);
  }

  /**
   * Asks about two files, of which nothing is kept.
   * @param {Blob} a with its name if it is a File
   * @param {Blob} b
   * @param {Record<string, unknown>} [request] a request of a job of two meshes, without them; a comparison without a
   *   type
   * @param {Options} [options]
   * @returns {Promise<JobResult>}
   */
  compare(a, b, request = {}, { signal } = {}) {
    const body = new FormData();
    body.append("a", a);
    body.append("b", b);
    body.append("options", JSON.stringify(request));
    return this.transport.json("/v1/compare", { method: "POST", body, signal });
  }

  /**
   * Asks many questions; their answers come in the order in which they end.
   * @param {Iterable<JobRequest & { key?: string | number }>} requests
   * @param {Options} [options]
   * @returns {AsyncGenerator<BatchAnswer, void>}
   */
  async *batch(requests, { signal } = {}) {
    const body = new Blob(Array.from(requests, (request) => `${JSON.stringify(request)}\n`));
    const headers = { ...STREAM, "Content-Type": "application/x-ndjson" };
    const response = await this.transport.send("/v1/batches", { method: "POST", headers, body, signal });
    for await (const answer of readLines(response, signal)) if (!answer.event) yield answer;
  }
}

/**
 * @param {Response} response
 * @param {AbortSignal} [signal]
 * @returns {AsyncGenerator<JobEvent, void>} up to the terminal event; a stream without one throws ConnectionError
 */
async function* readEvents(response, signal) {
  for await (const event of readLines(response, signal)) {
    if (event.event === "server_shutdown") throw new ConnectionError("the daemon stops; the job will run again");
    if (/^(bounds|step|stage|result|error)$/.test(event.event)) yield event;
    if (event.event === "result" || event.event === "error") return;
  }
  throw new ConnectionError("the stream broke off");
}
