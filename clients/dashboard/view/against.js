// The worker's side of distances between two surfaces: the colours of one by its distance from the other, and the distance of a point.

import { FOOT_WIDTH } from "../js/meshes.js";
import { CLOUD_PIECE } from "./cloud.js";
import { FlatFaces } from "./flat.js";
import { cornerValues, drawnTriangles, heatPieces, pointValues, worstError } from "./heat.js";
import { Sides } from "./sides.js";
import { cornerNormals, faceNormals, facesOfVertices } from "./topology.js";

/** @import { Meshes } from "../js/meshes.js" */
/** @import { Refined } from "./refine.js" */
/** @import { Kept } from "./worker.js" */
/** Which sign the side has that the normals of the other surface point to; 0 where none is asked for. @typedef {-1 | 0 | 1} Turn */
/** @typedef {{ id: string, key: string, quads: "triangles" | "bilinear", turn: Turn, target: number, most: number }} Question
 *   id, key: the other surface, as it is now; target: the error that is small enough; most: triangles */

/** @type {WeakMap<Kept, Sides>} */
const sidesOfSurface = new WeakMap();

/** Tells inside from outside of a surface; null for points. @param {Kept} surface */
function sidesAbout(surface) {
  if (surface.shape.starts.length <= 1) return null;
  const known = sidesOfSurface.get(surface) ?? new Sides(surface.shape);
  sidesOfSurface.set(surface, known);
  return known;
}

export class Against {
  /**
   * @param {Kept} surface that is coloured
   * @param {(message: any, transfer?: Transferable[]) => void} post
   * @param {() => boolean} isWanted is the surface still shown?
   */
  constructor(surface, post, isWanted) {
    this.surface = surface;
    this.post = post;
    this.isWanted = isWanted;
    this.key = "";
    /** @type {Refined | null} */
    this.refined = null;
    /** @type {Promise<unknown>} */
    this.before = Promise.resolve();
  }

  /** One after the other. @param {Meshes} meshes @param {Kept | undefined} other @param {Question} question */
  colour(meshes, other, question) {
    const next = this.before.then(() => this.paint(meshes, other, question));
    this.before = next.catch(() => {});
    return next;
  }

  /**
   * Cuts the surface where its distance is not linear, and sends it in the colours.
   * @param {Meshes} meshes
   * @param {Kept | undefined} other
   * @param {Question} question
   */
  async paint(meshes, other, { id, key, quads, turn, target, most }) {
    const { shape, steps } = this.surface;
    if (this.key !== key || !this.refined) this.refined = drawnTriangles(shape, steps);
    this.key = key;
    const { refined } = this;
    // Where no more triangles are allowed, to know more of their error is not worth the time.
    const flat = other && other.shape.starts.length > 1 && refined.count < most ? new FlatFaces(other.shape) : null;
    await refined.refine((points) => findFeet(meshes, id, points, quads), { target, most, flat, isWanted: this.isWanted });
    const about = turn !== 0 && other ? sidesAbout(other) : null;
    const sides = about && sidesOf(refined, about, turn);
    this.send(refined, sides);
    return { error: worstError(refined, sides), triangles: refined.count, sides: sides?.slice(0, shape.points.length / 3) ?? null };
  }

  /** Triangles in the place of those that they are parts of; where none was cut, values alone. @param {Refined} refined @param {Int8Array | null} sides */
  send(refined, sides) {
    const { shape, steps } = this.surface;
    let place = 0;
    this.post({ kind: "new heat" });
    const values = shape.starts.length <= 1 ? pointValues(refined, sides, CLOUD_PIECE) : refined.isCut ? [] : cornerValues(shape, steps, refined, sides);
    for (const value of values) this.post({ kind: "values", place: place++, value }, [value.buffer]);
    if (!refined.isCut) return;
    const normals = cornerNormals(shape, faceNormals(shape), facesOfVertices(shape));
    for (const piece of heatPieces({ ...this.surface, normals }, refined, sides)) {
      this.post({ kind: "heat", ...piece }, [piece.position.buffer, piece.normal.buffer, piece.edge.buffer, piece.tint.buffer, piece.value.buffer]);
    }
  }
}

/**
 * @param {Meshes} meshes
 * @param {string} id
 * @param {Float64Array<ArrayBuffer>} points
 * @param {"triangles" | "bilinear"} quads
 * @returns {Promise<import("./refine.js").Feet>}
 */
async function findFeet(meshes, id, points, quads) {
  const count = points.length / 3;
  const feet = { distance: new Float64Array(count), foot: new Float64Array(3 * count), face: new Int32Array(count) };
  let point = 0;
  for await (const rows of meshes.project(id, points, { quads })) {
    for (let at = 0; at < rows.length; at += FOOT_WIDTH, point++) {
      feet.distance[point] = rows[at];
      feet.foot.set(rows.subarray(at + 1, at + 4), 3 * point);
      feet.face[point] = rows[at + 4];
    }
  }
  return feet;
}

/** On which side of another surface each point lies. @param {Refined} refined @param {Sides} sides @param {Turn} turn */
function sidesOf({ points, feet: { foot, face } }, sides, turn) {
  return Int8Array.from(face, (on, point) => turn * sides.sideOf([...points.subarray(3 * point, 3 * point + 3)], foot.subarray(3 * point, 3 * point + 3), on));
}

/**
 * How far a point lies from a surface, and on which side: 1 outside, -1 inside, 0 not asked for.
 * @param {Meshes} meshes
 * @param {Kept} surface
 * @param {{ id: string, point: number[], quads: "triangles" | "bilinear", turn: Turn }} question
 */
export async function probe(meshes, surface, { id, point, quads, turn }) {
  const { distance: [distance], foot, face: [face] } = await findFeet(meshes, id, Float64Array.from(point), quads);
  const sides = turn !== 0 ? sidesAbout(surface) : null;
  return { distance, side: sides ? turn * sides.sideOf(point, foot, face) : 0 };
}
