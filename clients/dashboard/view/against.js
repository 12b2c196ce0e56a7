// The worker's side of distances between two surfaces: the colours of one by its distance from the other, and the distance of a point.

import { FOOT_WIDTH } from "../js/meshes.js";
import { CLOUD_PIECE } from "./cloud.js";
import { FlatFaces } from "./flat.js";
import { cornerValues, drawnTriangles, heatPieces, pointValues, worstError } from "./heat.js";
import { provenSides } from "./proof.js";
import { Sides } from "./sides.js";
import { cornerNormals, faceNormals, facesOfVertices } from "./topology.js";
import { Winding } from "./winding.js";

/** @import { Meshes } from "../js/meshes.js" */
/** @import { Refined } from "./refine.js" */
/** @import { Kept } from "./worker.js" */
/** How sides are told from one another: not at all; by winding numbers about a solid, which is proven; by the normals of the nearest faces.
 * @typedef {"none" | "solid" | "normal"} Telling */
/** @typedef {{ id: string, key: string, quads: "triangles" | "bilinear", telling: Telling, target: number, most: number }} Question
 *   id, key: the other surface, as it is now; target: the error that is small enough; most: triangles */

/** What was made for a surface. @type {WeakMap<Kept, { sides?: Sides, triangles?: Winding, bilinear?: Winding }>} */
const made = new WeakMap();

/** @param {Kept} surface */
function madeOf(surface) {
  const known = made.get(surface) ?? {};
  made.set(surface, known);
  return known;
}

/** Tells by normals. @param {Kept} surface */
const sidesAbout = (surface) => madeOf(surface).sides ??= new Sides(surface.shape);

/** Tells by winding numbers. @param {Kept} surface @param {"triangles" | "bilinear"} quads */
const windingAbout = (surface, quads) => madeOf(surface)[quads] ??= new Winding(surface.shape, quads === "bilinear");

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
    this.key = this.question = "";
    /** The distances of the points before any triangle is cut. @type {import("./refine.js").Feet | null} */
    this.feet = null;
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
  async paint(meshes, other, { id, key, quads, telling, target, most }) {
    const { shape, steps } = this.surface;
    const hasSides = telling !== "none" && other && other.shape.starts.length > 1;
    const question = `${target} ${most} ${Boolean(hasSides)}`;
    if (this.key !== key) this.feet = null;
    // What was cut for another question would be colours that depend on what was asked before: a link could not bring them back.
    if (this.key !== key || this.question !== question || !this.refined) {
      this.refined = drawnTriangles(shape, steps);
      this.refined.feet = this.feet ?? this.refined.feet;
    }
    [this.key, this.question] = [key, question];
    const { refined } = this;
    // Where no more triangles are allowed, to know more of their error is not worth the time.
    const flat = other && other.shape.starts.length > 1 && refined.count < most ? new FlatFaces(other.shape) : null;
    const measure = async (/** @type {Float64Array<ArrayBuffer>} */ points) => {
      const feet = await findFeet(meshes, id, points, quads);
      this.feet ??= feet;
      return feet;
    };
    await refined.refine(measure, { target, most, flat, isSigned: Boolean(hasSides), isWanted: this.isWanted });
    const sides = !hasSides ? null : telling === "solid" ? provenSides(refined, windingAbout(other, quads)) : sidesOf(refined, sidesAbout(other));
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

/** On which side of another surface each point lies. @param {Refined} refined @param {Sides} sides */
function sidesOf({ points, feet: { foot, face } }, sides) {
  return Int8Array.from(face, (on, point) => sides.sideOf([...points.subarray(3 * point, 3 * point + 3)], foot.subarray(3 * point, 3 * point + 3), on));
}

/**
 * How far a point lies from a surface, and on which side: 1 outside, -1 inside, 0 not asked for or not known.
 * @param {Meshes} meshes
 * @param {Kept} surface
 * @param {{ id: string, point: number[], quads: "triangles" | "bilinear", telling: Telling }} question
 */
export async function probe(meshes, surface, { id, point, quads, telling }) {
  const { distance: [distance], foot, face: [face] } = await findFeet(meshes, id, Float64Array.from(point), quads);
  if (telling === "none" || surface.shape.starts.length <= 1) return { distance, side: 0 };
  if (telling === "normal") return { distance, side: sidesAbout(surface).sideOf(point, foot, face) };
  const winding = distance > 0 ? windingAbout(surface, quads).of(point) : null;
  return { distance, side: winding === null ? 0 : winding === 0 ? 1 : -1 };
}
