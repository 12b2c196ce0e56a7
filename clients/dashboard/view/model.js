// One mesh or point set in the scene: its pieces as they come from the worker.

import {
  BufferAttribute, BufferGeometry, Group, Mesh as Drawn, Points, Sphere, Vector3,
} from "three";

import { makeDiscs, makeMarks, makeRegions, makeSurface } from "./materials.js";
import { moveBox } from "./transform.js";

/** @import { Data3DTexture, ShaderMaterial } from "three" */
/** @import { Mesh, Transform } from "../../js/types.js" */
/** @import { Plane } from "./plane.js" */

// Positions lie within half a unit of the centre: no piece needs a look to know its bounds.
const BOUNDS = new Sphere(new Vector3(), 1);

export class Model {
  /**
   * @param {Mesh} mesh
   * @param {boolean} isBilinear
   * @param {Transform | null} [transform] that moves the mesh
   */
  constructor(mesh, isBilinear, transform = null) {
    this.mesh = mesh;
    this.isBilinear = isBilinear;
    this.transform = transform;
    /** What cuts it in the view. @type {Plane | null} */
    this.plane = null;
    this.box = moveBox(mesh.bounding_box, transform);
    const { min, max, diagonal } = this.box;
    this.frame = { centre: min.map((low, k) => low / 2 + max[k] / 2), scale: diagonal > 0 ? 1 / diagonal : 1 };
    this.group = new Group();
    /** The mesh itself, and in its place the parts that it is cut into to show distances. */
    this.body = new Group();
    this.heat = new Group();
    this.group.add(this.body, this.heat);
    this.surface = makeSurface();
    this.discs = makeDiscs();
    this.marks = makeMarks();
    this.isWhole = false;
    /** Settles when it is, or cannot be read. @type {Promise<void> | undefined} */
    this.whole = undefined;
    /** @type {(Drawn | Points)[]} */
    this.pieces = [];
    /** How many of them are drawn. */
    this.inside = 0;
    /** About the distance of neighbouring points. */
    this.spacing = 1 / Math.sqrt(Math.max(1, mesh.vertices));
    /** Of all triangles, those from one place to another are drawn. @type {[number, number]} */
    this.range = [0, Infinity];
    /** @type {Points | null} */
    this.irregular = null;
    /** @type {Data3DTexture | null} */
    this.regions = null;
  }

  /** Puts the model where it is in the frame of another. @param {{ centre: number[], scale: number }} frame */
  place(frame) {
    const own = this.frame;
    this.group.scale.setScalar(frame.scale / own.scale);
    this.group.position.fromArray(own.centre.map((value, k) => (value - frame.centre[k]) * frame.scale));
  }

  /** @param {{ position: Float32Array, normal: Int8Array, edge: Uint8Array, tint: Uint8Array }} piece */
  addPiece({ position, normal, edge, tint }) {
    const geometry = makeGeometry(position);
    geometry.setAttribute("normal", new BufferAttribute(normal, 4, true));
    geometry.setAttribute("edge", new BufferAttribute(edge, 4, true));
    geometry.setAttribute("tint", new BufferAttribute(tint, 4, true));
    this.add(new Drawn(geometry, this.surface));
  }

  /** @param {import("./heat.js").HeatPiece} piece */
  addHeat({ position, normal, edge, tint, value }) {
    const geometry = makeGeometry(position);
    geometry.setAttribute("normal", new BufferAttribute(normal, 4, true));
    geometry.setAttribute("edge", new BufferAttribute(edge, 4, true));
    geometry.setAttribute("tint", new BufferAttribute(tint, 4, true));
    geometry.setAttribute("value", new BufferAttribute(value, 2));
    const piece = new Drawn(geometry, this.surface);
    piece.frustumCulled = false;
    this.heat.add(piece);
  }

  /** @param {boolean} isShown */
  showHeat(isShown) {
    this.heat.visible = isShown;
    this.body.visible = !isShown || this.heat.children.length === 0;
  }

  dropHeat() {
    for (const piece of this.heat.children) /** @type {Drawn} */ (piece).geometry.dispose();
    this.heat.clear();
  }

  /** @param {Float32Array} position */
  addPoints(position) {
    this.add(new Points(makeGeometry(position), this.discs));
  }

  /** @param {Drawn | Points} piece */
  add(piece) {
    piece.frustumCulled = false;
    this.pieces.push(piece);
    this.setRange(...this.range);
  }

  /**
   * Lets some more pieces be drawn: each is sent to the graphics card when it first is, and many at once would make the page
   * wait.
   * @param {number} [most]
   * @returns {boolean} whether others wait
   */
  letIn(most = Infinity) {
    for (const piece of this.pieces.slice(this.inside, this.inside + most)) {
      this.body.add(piece);
      this.inside++;
    }
    return this.inside < this.pieces.length;
  }

  /** Draws some of the triangles alone, in the order of the file. @param {number} from @param {number} to */
  setRange(from, to) {
    this.range = [from, to];
    let first = 0;
    for (const piece of this.pieces) {
      if (piece instanceof Points) return;
      const { geometry } = piece;
      const count = geometry.getAttribute("position").count / 3;
      const [start, end] = [from, to].map((place) => Math.max(0, Math.min(count, place - first)));
      geometry.setDrawRange(3 * start, 3 * (end - start));
      first += count;
    }
  }

  /** @param {number} place @param {Int8Array} normal @param {number} spacing */
  setNormals(place, normal, spacing) {
    this.spacing = spacing;
    this.pieces[place].geometry.setAttribute("facing", new BufferAttribute(normal, 4, true));
  }

  /** @param {number} place @param {Float32Array} position @param {Int8Array} normal */
  movePiece(place, position, normal) {
    const { geometry } = this.pieces[place];
    geometry.setAttribute("position", new BufferAttribute(position, 3));
    geometry.setAttribute("normal", new BufferAttribute(normal, 4, true));
  }

  /** @param {number} place @param {Float32Array} value */
  setValues(place, value) {
    this.pieces[place].geometry.setAttribute("value", new BufferAttribute(value, 2));
  }

  /** @param {Float32Array} position @param {Float32Array} valence */
  setIrregular(position, valence) {
    const geometry = makeGeometry(position);
    geometry.setAttribute("value", new BufferAttribute(valence, 1));
    this.irregular = new Points(geometry, this.marks);
    this.irregular.frustumCulled = false;
    this.irregular.renderOrder = 1;
    this.group.add(this.irregular);
  }

  /**
   * Colours by place; null takes them away.
   * @param {{ colours: Uint8Array, sides: number[], low: number[], size: number } | null} regions
   */
  setRegions(regions) {
    this.regions?.dispose();
    this.regions = regions ? makeRegions(regions.colours, regions.sides) : null;
    for (const { uniforms } of [this.surface, this.discs]) {
      uniforms.regioned.value = regions ? 1 : 0;
      if (!regions) continue;
      uniforms.regions.value = this.regions;
      uniforms.regionLow.value.fromArray(regions.low);
      uniforms.regionSize.value.fromArray(regions.sides).multiplyScalar(regions.size);
    }
  }

  /** @returns {ShaderMaterial[]} */
  materials() {
    return [this.surface, this.discs, this.marks];
  }

  dispose() {
    this.group.removeFromParent();
    this.dropHeat();
    for (const piece of this.pieces) piece.geometry.dispose();
    this.irregular?.geometry.dispose();
    this.regions?.dispose();
    for (const material of this.materials()) material.dispose();
  }
}

/** @param {Float32Array} position */
function makeGeometry(position) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  geometry.boundingSphere = BOUNDS;
  return geometry;
}

/** Something of each kind, which is kept, and its programs with it. */
export function makeSample() {
  const make = (/** @type {string[]} */ ...names) => { // a program depends on the attributes
    const geometry = makeGeometry(new Float32Array(9));
    for (const name of names) geometry.setAttribute(name, new BufferAttribute(new Uint8Array(12), 4, true));
    return geometry;
  };
  return new Group().add(new Drawn(make("normal", "edge", "tint"), makeSurface()), new Points(make("facing"), makeDiscs()),
    new Points(make("value"), makeMarks()));
}
