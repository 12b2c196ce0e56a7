// /v1/layouts: quad layouts over a surface, drawn stroke by stroke.

import { readPages } from "./pages.js";

/** @import { AutoLayoutRequest, EditedLayout, Layout, LayoutBrief, LayoutRequest, Point, QuadLayoutRequest, Stroke } from "./types.js" */
/** @import { Transport } from "./transport.js" */
/** @typedef {{ signal?: AbortSignal }} Options */

/** @param {string} id */
const pathOf = (id) => `/v1/layouts/${encodeURIComponent(id)}`;

export class Layouts {
  /** @param {Transport} transport */
  constructor(transport) {
    this.transport = transport;
  }

  /**
   * @param {string} path
   * @param {unknown} body
   * @param {Options} options
   */
  post(path, body, { signal }) {
    const headers = { "Content-Type": "application/json" };
    return this.transport.json(path, { method: "POST", headers, body: JSON.stringify(body), signal });
  }

  /**
   * Empty, given whole, or of the quads of a mesh.
   * @param {LayoutRequest | QuadLayoutRequest | AutoLayoutRequest} request
   * @param {Options} [options]
   * @returns {Promise<Layout>}
   */
  create(request, options = {}) {
    return this.post("/v1/layouts", request, options);
  }

  /**
   * All layouts in order of creation, without their curves.
   * @param {Options & { pageSize?: number, order?: "oldest" | "newest", mesh?: string }} [options]
   * @returns {AsyncGenerator<LayoutBrief, void>}
   */
  list(options = {}) {
    return readPages(this.transport, "/v1/layouts", "layouts", options);
  }

  /**
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<Layout>}
   */
  get(id, { signal } = {}) {
    return this.transport.json(pathOf(id), { signal });
  }

  /**
   * @param {string} id
   * @param {Options} [options]
   */
  async delete(id, { signal } = {}) {
    await this.transport.send(pathOf(id), { method: "DELETE", signal });
  }

  /**
   * Draws a curve in the window.
   * @param {string} id
   * @param {Stroke} stroke
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  stroke(id, stroke, options = {}) {
    return this.post(`${pathOf(id)}/strokes`, stroke, options);
  }

  /**
   * Cuts a curve at its point nearest to a place.
   * @param {string} id
   * @param {number} curve
   * @param {Point} point
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  split(id, curve, point, options = {}) {
    return this.post(`${pathOf(id)}/curves/${curve}/split`, { point }, options);
  }

  /**
   * Puts an end of a curve on another node or curve.
   * @param {string} id
   * @param {number} curve
   * @param {{ end: "from" | "to", point: Point, radius?: number }} where
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  snap(id, curve, where, options = {}) {
    return this.post(`${pathOf(id)}/curves/${curve}/snap`, where, options);
  }

  /**
   * Redraws a curve between its nodes, from either end.
   * @param {string} id
   * @param {number} curve
   * @param {Point[] | Stroke} line points in space, or a stroke in the window
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  redraw(id, curve, line, options = {}) {
    return this.post(`${pathOf(id)}/curves/${curve}/redraw`, Array.isArray(line) ? { points: line } : line, options);
  }

  /**
   * Joins two curves at a node that is theirs alone.
   * @param {string} id
   * @param {number} first which keeps its id
   * @param {number} second
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  merge(id, first, second, options = {}) {
    return this.post(`${pathOf(id)}/curves/merge`, { first, second }, options);
  }

  /**
   * Takes a curve away.
   * @param {string} id
   * @param {number} curve
   * @param {Options} [options]
   * @returns {Promise<EditedLayout>}
   */
  deleteCurve(id, curve, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/curves/${curve}`, { method: "DELETE", signal });
  }

  /**
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<Layout>}
   */
  undo(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/undo`, { method: "POST", signal });
  }

  /**
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<Layout>}
   */
  redo(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/redo`, { method: "POST", signal });
  }
}
