// What went wrong: a refusal of the daemon, or no answer at all.

/** @import { Problem, ProblemPlace } from "./types.js" */

/** A refusal of the daemon (RFC 9457). */
export class ProblemError extends Error {
  /**
   * @param {Problem} problem
   * @param {number | null} retryAfter
   */
  constructor(problem, retryAfter = null) {
    super(problem.detail || problem.title);
    this.name = "ProblemError";
    /** The HTTP status. */
    this.status = problem.status;
    /** A stable name for programs, such as "mesh_not_found". */
    this.code = problem.code;
    this.title = problem.title;
    this.detail = problem.detail;
    /** The places of the fault: a line or byte of a file, a member of a request.
     * @type {ProblemPlace[]} */
    this.places = problem.errors ?? [];
    /** The request that was refused, as the daemon's log names it. */
    this.instance = problem.instance ?? null;
    /** Seconds after which another attempt makes sense. */
    this.retryAfter = retryAfter;
  }

  /** Whether the request may succeed later. */
  get isTemporary() {
    return this.status === 429 || this.status === 503;
  }
}

/** The daemon could not be reached, or its answer broke off. */
export class ConnectionError extends Error {
  /**
   * @param {string} message
   * @param {unknown} [cause]
   */
  constructor(message, cause) {
    super(message, { cause });
    this.name = "ConnectionError";
  }
}

/**
 * The problem of a reply that is no success; one is made up when the reply has none (a proxy's page, say).
 * @param {Response} response
 * @returns {Promise<ProblemError>}
 */
export async function readProblem(response) {
  const text = await response.text().catch(() => "");
  return makeProblem(response.status, text, response.headers.get("Retry-After"));
}

/**
 * @param {number} status
 * @param {string} text the body
 * @param {string | null} retryAfter the header
 */
export function makeProblem(status, text, retryAfter) {
  const seconds = retryAfter === null ? NaN : Number(retryAfter);
  /** @type {Problem} */
  let problem = { type: "about:blank", title: `status ${status}`, status, code: "unknown", detail: `status ${status}` };
  try {
    problem = { ...problem, ...JSON.parse(text) };
  } catch {
    // Not the daemon's own words; the status has to do.
  }
  return new ProblemError(problem, Number.isFinite(seconds) ? seconds : null);
}
