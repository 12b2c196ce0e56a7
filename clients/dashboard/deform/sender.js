// Sends where vertices have gone, one revision at a time, and asks after each which faces meet now. What was uploaded stays as it
// was: the first drag makes a copy.

import { client } from "../core/connection.js";
import { meshOf, state } from "../core/state.js";
import { moveNear } from "../view/loader.js";

/** @import { CollisionResult, Mesh } from "../../js/types.js" */
/** @import { Model } from "../view/model.js" */
/** @typedef {{ revision: number, moved: number, updated_nodes: number, refit_ms: number, collisions: CollisionResult,
 *   pairs: Float64Array, round_ms: number }} Round */
/** @typedef {{ indices: number[], positions: [number, number, number][] }} Places */

/** What vertices of copies were before each drag, also when the view is left meanwhile: by mesh. @type {Map<string, Places[]>} */
const undosOf = new Map();

export class Sender {
  /**
   * @param {(round: Round) => void} onRound
   * @param {(error: unknown) => void} onFault
   * @param {(copy: Mesh) => void} onCopy called when a copy is taken in the place of a mesh
   */
  constructor(onRound, onFault, onCopy) {
    this.onCopy = onCopy;
    this.onRound = onRound;
    this.onFault = onFault;
    /** @type {{ model: Model, centre: number[], radius: number } | null} */
    this.handle = null;
    /** The newest offset that was not sent. @type {number[] | null} */
    this.wanted = null;
    /** @type {Promise<void> | null} */
    this.sending = null;
  }

  /** The drags of a mesh that can be undone. @param {string | null} id */
  static undosOf(id) {
    return undosOf.get(id ?? "") ?? [];
  }

  /** Makes the model one of a copy, unless it is. @param {Model} model */
  async copy(model) {
    const { id } = model.mesh;
    if (undosOf.has(id)) return;
    const name = freeName(model.mesh.name || id);
    const { bytes } = await client.meshes.content(id, { format: "ply" }); // with every coordinate as it is
    const { mesh } = await client.meshes.create(bytes, { name, format: "ply" });
    undosOf.set(mesh.id, []);
    model.mesh = mesh;
    this.onCopy(mesh);
  }

  /** @param {Model} model @param {number[]} centre @param {number} radius */
  async take(model, centre, radius) {
    await this.sending;
    await this.copy(model);
    this.handle = { model, centre, radius };
    Sender.undosOf(model.mesh.id).push(await moveNear(model, { centre, radius, offset: [0, 0, 0], starts: true }));
  }

  /** Newer offsets overtake those that wait. @param {number[]} offset */
  move(offset) {
    this.wanted = offset;
    this.sending ??= this.send().catch(this.onFault).finally(() => { this.sending = null; });
  }

  async send() {
    while (this.wanted && this.handle) {
      const { model, centre, radius } = this.handle;
      const offset = this.wanted;
      this.wanted = null;
      await this.apply(model, await moveNear(model, { centre, radius, offset, starts: false }));
    }
  }

  /** @param {Model} model @param {Places} places */
  async apply(model, { indices, positions }) {
    if (indices.length === 0) return;
    const start = performance.now();
    const { id } = model.mesh;
    const { revision, updated_nodes, refit_ms } = await client.meshes.deform(id, { indices, positions });
    model.mesh = { ...model.mesh, revision };
    state.meshes = state.meshes.map((mesh) => (mesh.id === id ? { ...mesh, revision } : mesh));
    const job = await client.jobs.create({ type: "self_collision", mesh: id, incremental: true, limit: 100 }, { wait: 60 });
    if (!job.result) throw new Error(job.problem?.detail ?? "the search for collisions takes too long");
    this.onRound({
      revision, moved: indices.length, updated_nodes, refit_ms, collisions: /** @type {CollisionResult} */ (job.result),
      pairs: await client.jobs.pairs(job.id), round_ms: performance.now() - start,
    });
  }

  /** Puts the vertices of the last drag back; the view has to read the mesh again. @param {string} id */
  async undo(id) {
    await this.sending;
    const places = Sender.undosOf(id).pop();
    if (!places || !meshOf(id)) return;
    await client.meshes.deform(id, places);
  }
}

/** A name that no mesh has: the same bytes by the same name would be the same mesh, which may be deformed already. @param {string} name */
function freeName(name) {
  const stem = name.replace(/, deformed( \d+)?$/, "");
  for (let number = 1; ; number++) {
    const wanted = `${stem}, deformed${number > 1 ? ` ${number}` : ""}`;
    if (!state.meshes.some((mesh) => mesh.name === wanted)) return wanted;
  }
}
