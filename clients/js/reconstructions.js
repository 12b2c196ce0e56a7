// /v1/reconstructions: quad meshes that grow out of layouts. Jobs of type "reconstruction_step" refine them.

import { readPages } from "./pages.js";

/** @import { Format, Reconstruction, ReconstructionBrief, ReconstructionPatches, ReconstructionRequest } from "./types.js" */
/** @import { Transport } from "./transport.js" */
/** @typedef {{ signal?: AbortSignal }} Options */

/** @param {string} id */
const pathOf = (id) => `/v1/reconstructions/${encodeURIComponent(id)}`;

export class Reconstructions {
  /** @param {Transport} transport */
  constructor(transport) {
    this.transport = transport;
  }

  /**
   * Starts with one quad a patch.
   * @param {ReconstructionRequest} request
   * @param {Options} [options]
   * @returns {Promise<Reconstruction>}
   */
  create(request, { signal } = {}) {
    const headers = { "Content-Type": "application/json" };
    return this.transport.json("/v1/reconstructions", { method: "POST", headers, body: JSON.stringify(request), signal });
  }

  /**
   * All of them in order of creation, without their steps.
   * @param {Options & { pageSize?: number, order?: "oldest" | "newest", mesh?: string }} [options]
   * @returns {AsyncGenerator<ReconstructionBrief, void>}
   */
  list(options = {}) {
    return readPages(this.transport, "/v1/reconstructions", "reconstructions", options);
  }

  /**
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<Reconstruction>}
   */
  get(id, { signal } = {}) {
    return this.transport.json(pathOf(id), { signal });
  }

  /**
   * Takes over an edited layout; only the patches that the edits have touched are computed again.
   * @param {string} id
   * @param {string} layout
   * @param {Options} [options]
   * @returns {Promise<Reconstruction & { redone_patches: number }>}
   */
  takeLayout(id, layout, { signal } = {}) {
    const headers = { "Content-Type": "application/json" };
    return this.transport.json(`${pathOf(id)}/layout`, { method: "PUT", headers, body: JSON.stringify({ layout }), signal });
  }

  /**
   * The current mesh as a file.
   * @param {string} id
   * @param {Options & { format?: Format }} [options]
   * @returns {Promise<ArrayBuffer>}
   */
  mesh(id, { format, signal } = {}) {
    return this.transport.bytes(`${pathOf(id)}/mesh`, { query: { format }, signal });
  }

  /**
   * The patches of the current mesh.
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<ReconstructionPatches>}
   */
  patches(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/patches`, { signal });
  }

  /**
   * Forgets a reconstruction; its meshes stay.
   * @param {string} id
   * @param {Options} [options]
   */
  async delete(id, { signal } = {}) {
    await this.transport.send(pathOf(id), { method: "DELETE", signal });
  }
}
