// One request and its reply over fetch; refusals and lost connections become errors of their own kind.

import { ConnectionError, readProblem } from "./problem.js";

/** @typedef {{ method?: string, query?: Record<string, string | number | boolean | null | undefined>,
 *   headers?: Record<string, string | undefined>, body?: BodyInit, signal?: AbortSignal }} Call */

export class Transport {
  /** @param {{ base?: string, token?: string | null, fetch?: typeof fetch }} options */
  constructor({ base = "", token = null, fetch: fetcher = globalThis.fetch } = {}) {
    this.base = base.replace(/\/$/, "");
    /** Kept in memory only. @type {string | null} */
    this.token = token;
    this.fetch = fetcher.bind(globalThis);
  }

  /**
   * @param {string} path
   * @param {Call["query"]} [query] members that are null or undefined are left out
   */
  url(path, query = {}) {
    const search = new URLSearchParams();
    for (const [name, value] of Object.entries(query)) {
      if (value !== undefined && value !== null) search.set(name, String(value));
    }
    return `${this.base}${path}${search.size > 0 ? `?${search}` : ""}`;
  }

  /** @param {Record<string, string | undefined>} headers */
  headers(headers) {
    const given = Object.entries({ Authorization: this.token ? `Bearer ${this.token}` : undefined, ...headers });
    return /** @type {Record<string, string>} */ (Object.fromEntries(given.filter(([, value]) => value !== undefined)));
  }

  /**
   * @param {string} path
   * @param {Call} [call]
   * @returns {Promise<Response>} a success, or 304
   * @throws {ProblemError | ConnectionError | DOMException} the last one when the signal was given
   */
  async send(path, { method = "GET", query, headers = {}, body, signal } = {}) {
    let response;
    try {
      response = await this.fetch(this.url(path, query), { method, headers: this.headers(headers), body, signal });
    } catch (error) {
      signal?.throwIfAborted();
      throw new ConnectionError("the daemon does not answer", error);
    }
    if (!response.ok && response.status !== 304) throw await readProblem(response);
    return response;
  }

  /**
   * @param {string} path
   * @param {Call} [call]
   */
  async json(path, call = {}) {
    const response = await this.send(path, { ...call, headers: { Accept: "application/json", ...call.headers } });
    return whole(response.json(), call.signal);
  }

  /**
   * @param {string} path
   * @param {Call} [call]
   */
  async bytes(path, call = {}) {
    return whole((await this.send(path, call)).arrayBuffer(), call.signal);
  }

  /**
   * @param {string} path
   * @param {Call} [call]
   */
  async text(path, call = {}) {
    return whole((await this.send(path, call)).text(), call.signal);
  }
}

/**
 * @template T
 * @param {Promise<T>} body
 * @param {AbortSignal} [signal]
 */
async function whole(body, signal) {
  try {
    return await body;
  } catch (error) {
    signal?.throwIfAborted();
    throw new ConnectionError("the answer broke off", error);
  }
}
