// /v1/meshes: triangle meshes, quad meshes, mixtures of both, and point sets.

import { readPages } from "./pages.js";
import { ProblemError } from "./problem.js";
import { readRows } from "./stream.js";
import { uploadWithProgress } from "./upload.js";

/** @import { Accelerator, Format, Mesh, Patches, Point, QuadReading, QualitySummary, Transform, Unit } from "./types.js" */
/** @import { Transport } from "./transport.js" */
/** @import { OnProgress } from "./upload.js" */

/** @param {string} id */
const pathOf = (id) => `/v1/meshes/${encodeURIComponent(id)}`;

/** The numbers of a row of `project`: distance, x, y, z of the nearest point, face, u, v. */
export const FOOT_WIDTH = 7;

export class Meshes {
  /** @param {Transport} transport */
  constructor(transport) {
    this.transport = transport;
  }

  /**
   * Uploads a file. The same bytes with the same name, format and notes give the same mesh again.
   * @param {Blob | ArrayBuffer | Uint8Array<ArrayBuffer> | string} file the raw bytes
   * @param {{ name?: string, format?: Format, ttlSeconds?: number, unit?: Unit, uncertainty?: number, labels?: string[],
   *   onProgress?: OnProgress, signal?: AbortSignal }} [options] ttlSeconds: after which the mesh is removed; onProgress is called where the
   *   platform reports it: in a browser
   * @returns {Promise<{ mesh: Mesh, isNew: boolean }>}
   */
  async create(file, { name, format, ttlSeconds, unit, uncertainty, labels, onProgress, signal } = {}) {
    const query = {
      name, format, ttl_seconds: ttlSeconds?.toString(), unit, uncertainty: uncertainty?.toString(),
      labels: labels?.length ? labels.join(",") : undefined,
    };
    const headers = { "Content-Type": "application/octet-stream", Accept: "application/json" };
    if (onProgress && globalThis.XMLHttpRequest) {
      const body = file instanceof Blob ? file : new Blob([file]);
      const reply = await uploadWithProgress(this.transport, "/v1/meshes", { query, headers, body, onProgress, signal });
      return { mesh: JSON.parse(reply.text), isNew: reply.status === 201 };
    }
    const response = await this.transport.send("/v1/meshes", { method: "POST", query, headers, body: file, signal });
    return { mesh: await response.json(), isNew: response.status === 201 };
  }

  /**
   * All meshes that pass the filters, in order of creation.
   * @param {{ pageSize?: number, order?: "oldest" | "newest", name?: string, content_hash?: string,
   *   label?: string, signal?: AbortSignal }} [options]
   * @returns {AsyncGenerator<Mesh, void>}
   */
  list(options = {}) {
    return readPages(this.transport, "/v1/meshes", "meshes", options);
  }

  /**
   * @param {string} id
   * @param {{ signal?: AbortSignal }} [options]
   * @returns {Promise<Mesh>}
   */
  get(id, { signal } = {}) {
    return this.transport.json(pathOf(id), { signal });
  }

  /**
   * The newest mesh of a file that was not deformed; null when there is none, and the file is to be uploaded.
   * @param {string} hash the SHA-256 of the file in hex
   * @param {{ signal?: AbortSignal }} [options]
   * @returns {Promise<Mesh | null>}
   */
  async find(hash, { signal } = {}) {
    try {
      return await this.transport.json(`/v1/meshes/sha256:${encodeURIComponent(hash)}`, { signal });
    } catch (error) {
      if (error instanceof ProblemError && error.code === "mesh_not_found") return null;
      throw error;
    }
  }

  /**
   * Changes what is known of the mesh; what is not given stays.
   * @param {string} id
   * @param {{ unit?: Unit | null, uncertainty?: number | null, labels?: string[] | null, ttl_seconds?: number | null }} change
   * @param {{ ifMatch?: string, signal?: AbortSignal }} [options]
   * @returns {Promise<Mesh>}
   */
  change(id, change, { ifMatch, signal } = {}) {
    return this.transport.json(pathOf(id), {
      method: "PATCH", body: JSON.stringify(change), signal,
      headers: { "Content-Type": "application/json", "If-Match": ifMatch },
    });
  }

  /**
   * Sets how long the mesh lives from now on; null: for good.
   * @param {string} id
   * @param {number | null} ttlSeconds
   * @param {{ ifMatch?: string, signal?: AbortSignal }} [options]
   * @returns {Promise<Mesh>}
   */
  setTtl(id, ttlSeconds, { ifMatch, signal } = {}) {
    return this.change(id, { ttl_seconds: ttlSeconds }, { ifMatch, signal });
  }

  /**
   * The mesh as a file.
   * @param {string} id
   * @param {{ format?: Format, quantization?: number, uv?: "patches", signal?: AbortSignal }} [options]
   * @returns {Promise<{ bytes: ArrayBuffer, name: string, displacement: number, cutFaces: number,
   *   leftOutVertices: number }>} with what the format lost
   */
  async content(id, { format, quantization, uv, signal } = {}) {
    const response = await this.transport.send(`${pathOf(id)}/content`, { query: { format, quantization, uv }, signal });
    const number = (/** @type {string} */ header) => Number(response.headers.get(header) ?? 0);
    return {
      bytes: await response.arrayBuffer(),
      name: /filename="([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? `${id}.${format ?? "ply"}`,
      displacement: number("Mesh-Displacement"),
      cutFaces: number("Mesh-Cut-Faces"),
      leftOutVertices: number("Mesh-Left-Out-Vertices"),
    };
  }

  /**
   * The regular patches of the quads.
   * @param {string} id
   * @param {{ signal?: AbortSignal }} [options]
   * @returns {Promise<Patches>}
   */
  patches(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/patches`, { signal });
  }

  /**
   * The shape of the faces by metrics of finite elements: all of them summed up.
   * @param {string} id
   * @param {{ signal?: AbortSignal }} [options]
   * @returns {Promise<{ metrics: QualitySummary[] }>}
   */
  quality(id, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/quality`, { signal });
  }

  /**
   * One metric with a value for each face, which is null where the face has none.
   * @param {string} id
   * @param {string} metric
   * @param {{ signal?: AbortSignal }} [options]
   * @returns {Promise<QualitySummary & { values: (number | null)[] }>}
   */
  qualityOfFaces(id, metric, { signal } = {}) {
    return this.transport.json(`${pathOf(id)}/quality`, { query: { metric }, signal });
  }

  /**
   * The nearest points of the mesh, as rows of FOOT_WIDTH numbers in the order of the input.
   * @param {string} id
   * @param {Float64Array<ArrayBuffer> | Float32Array<ArrayBuffer>} points rows of x, y, z
   * @param {{ quads?: QuadReading, threads?: number, accelerator?: Accelerator, transform?: Transform, signal?: AbortSignal }} [options]
   *   the transform moves the mesh before
   * @returns {AsyncGenerator<Float64Array, void>} whole rows, some at a time
   */
  async *project(id, points, { signal, transform, ...options } = {}) {
    const dtype = points instanceof Float32Array ? "f32" : "f64";
    const response = await this.transport.send(`${pathOf(id)}/project`, {
      method: "POST", query: { dtype, transform: transform?.join(","), ...options }, body: points, signal,
      headers: { "Content-Type": "application/octet-stream", Accept: "application/octet-stream" },
    });
    yield* readRows(response, FOOT_WIDTH, signal);
  }

  /**
   * Moves vertices: some, with their places, or all of them by rows of x, y, z.
   * @param {string} id
   * @param {{ indices: number[], positions: Point[] } | Float64Array<ArrayBuffer> | Float32Array<ArrayBuffer>} moved
   * @param {{ ifMatch?: string, signal?: AbortSignal }} [options]
   * @returns {Promise<{ revision: number, updated_nodes: number, refit_ms: number }>}
   */
  deform(id, moved, { ifMatch, signal } = {}) {
    const isBinary = ArrayBuffer.isView(moved);
    return this.transport.json(`${pathOf(id)}/vertices`, {
      method: "PATCH", body: isBinary ? moved : JSON.stringify(moved), signal,
      query: { dtype: moved instanceof Float32Array ? "f32" : undefined },
      headers: { "Content-Type": isBinary ? "application/octet-stream" : "application/json", "If-Match": ifMatch },
    });
  }

  /**
   * Keeps a moved copy, as a mesh of its own. Equal copies with equal names are one mesh.
   * @param {string} id
   * @param {Transform} transform
   * @param {{ name?: string, signal?: AbortSignal }} [options]
   * @returns {Promise<Mesh>}
   */
  copy(id, transform, { name, signal } = {}) {
    return this.transport.json(`${pathOf(id)}/copies`, {
      method: "POST", body: JSON.stringify({ transform, name }), signal, headers: { "Content-Type": "application/json" },
    });
  }

  /**
   * @param {string} id
   * @param {{ ifMatch?: string, signal?: AbortSignal }} [options]
   */
  async delete(id, { ifMatch, signal } = {}) {
    await this.transport.send(pathOf(id), { method: "DELETE", headers: { "If-Match": ifMatch }, signal });
  }
}
