// The daemon itself: what it is and how it is.

/** @import { Info } from "./types.js" */
/** @import { Transport } from "./transport.js" */
/** @typedef {{ signal?: AbortSignal }} Options */

export class System {
  /** @param {Transport} transport */
  constructor(transport) {
    this.transport = transport;
  }

  /**
   * Version, limits, formats.
   * @param {Options} [options]
   * @returns {Promise<Info>}
   */
  info({ signal } = {}) {
    return this.transport.json("/v1/info", { signal });
  }

  /**
   * @param {Options} [options]
   * @returns {Promise<{ status: "ok" }>}
   */
  health({ signal } = {}) {
    return this.transport.json("/healthz", { signal });
  }

  /**
   * Does the daemon take work? One that stops is refused with 503.
   * @param {Options} [options]
   * @returns {Promise<{ status: "ready" }>}
   */
  ready({ signal } = {}) {
    return this.transport.json("/readyz", { signal });
  }

  /**
   * Counters, gauges and histograms in Prometheus' text format.
   * @param {Options} [options]
   */
  metrics({ signal } = {}) {
    return this.transport.text("/metrics", { signal });
  }

  /**
   * The API's description, OpenAPI 3.1 as YAML.
   * @param {Options} [options]
   */
  description({ signal } = {}) {
    return this.transport.text("/openapi.yaml", { signal });
  }
}
