// The 3D view: which models are there, how they are drawn, and when. Loaded on demand, for three.js is large.

import { Box3, Color, ColorManagement, LinearSRGBColorSpace, Scene, Vector3, WebGLRenderer, WebGLRenderTarget } from "three";

import { colour } from "../core/dom.js";
import { Eye, START } from "./camera.js";
import { forget, load } from "./loader.js";
import { Model, makeSample } from "./model.js";
import { Overlay } from "./overlay.js";
import { Pair } from "./pair.js";
import { toUniform } from "./plane.js";
import { moveBox } from "./transform.js";

/** @import { Mesh, Transform } from "../../js/types.js" */
/** @import { Drawing } from "./overlay.js" */
/** @import { Plane } from "./plane.js" */
/** @import { Scale } from "./scale.js" */
/** @typedef {"a" | "b"} Role b is the one to compare with */
/** @typedef {{ mesh: Mesh, role: Role, isBilinear: boolean, isHidden?: boolean, isGhost?: boolean,
 *   isGradual?: boolean, transform?: Transform | null }} Wish transform: moves the mesh; isGradual: what was there before stays until endChange, and nothing of the new one is drawn yet */
/** @typedef {{ wire: boolean, patches: boolean, irregular: boolean, heat: boolean, structure: boolean, disc: number, through: boolean, scale: Scale,
 *   cut: Cut | null }} Look */
/** @typedef {{ axis: number, share: number, isOther: boolean }} Cut a section; share: of the way through all that is there */

const PIECES_A_FRAME = 2;

// Colours go to the screen as they are.
ColorManagement.enabled = false;

export class Stage {
  /**
   * @param {HTMLElement} place
   * @param {(words: string, share: number) => void} onProgress
   * @param {(isOn: boolean) => void} onThrough called when the surfaces are to be see-through
   */
  constructor(place, onProgress, onThrough) {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: false, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The meshes in 3D. Arrow keys turn, with Shift they move, plus and minus zoom, F shows all.");
    place.replaceChildren(this.canvas);
    this.place = place;
    this.onProgress = onProgress;
    this.onThrough = onThrough;
    this.scene = new Scene();
    this.eye = new Eye(this.canvas, () => this.draw(), () => this.fit());
    this.pair = new Pair(this.scene);
    this.overlay = new Overlay(this.scene);
    /** What lies over the meshes, by who drew it. @type {Map<string, Drawing>} */
    this.layers = new Map();
    /** @type {Map<Role, Model>} */
    this.models = new Map();
    /** Those that others take the place of by and by. @type {Map<Role, Model>} */
    this.leaving = new Map();
    /** @type {Wish[]} */
    this.wishes = [];
    this.frame = { centre: [0, 0, 0], scale: 1 };
    /** @type {Look} */
    this.look = { wire: false, patches: false, irregular: false, heat: false, structure: true, disc: 1, through: false, cut: null, scale: { low: 0, high: 1, isSigned: false, limits: null } };
    this.isWaiting = false;
    /** Are the programs of the graphics card there? */
    this.isReady = false;
    /** How many pictures are being read back. */
    this.readings = 0;
    /** Signalled when the last frame is on the screen. @type {WebGLSync | null} */
    this.last = null;
    new ResizeObserver(() => this.resize()).observe(place);
    this.resize();
    this.prepare();
  }

  /** Has the programs of all models compiled: who uses one before it is, waits, and the whole page with it. */
  async prepare() {
    const scene = new Scene();
    scene.add(makeSample());
    this.renderer.compile(scene, this.eye.camera);
    this.mark();
    while (this.isDrawing()) await new Promise((resolve) => { requestAnimationFrame(resolve); });
    const target = new WebGLRenderTarget(1, 1); // the first use asks for what the compiler has to say
    this.renderer.setRenderTarget(target);
    this.renderer.render(scene, this.eye.camera);
    this.renderer.setRenderTarget(null);
    target.dispose();
    this.isReady = true;
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.place;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.overlay.size.set(width, height);
    this.eye.camera.aspect = width / height;
    this.drawNow();
  }

  /**
   * Shows these meshes and no others. Resolves when they are whole.
   * @param {Wish[]} wishes the first one gives the frame
   */
  async show(wishes) {
    this.wishes = wishes;
    const before = this.frameId;
    const [first] = wishes;
    for (const [role, model] of this.models) {
      const wish = wishes.find((other) => other.role === role);
      if (wish && isSame(model, wish)) continue;
      if (wish?.isGradual) this.startChange(role, model);
      else this.remove(role);
    }
    for (const wish of wishes) if (!this.models.has(wish.role)) this.add(wish);
    if (first) {
      this.frame = /** @type {Model} */ (this.models.get(first.role)).frame;
      this.frameId = `${first.mesh.id} ${first.transform}`;
      this.eye.setSize(Math.max(1, ...wishes.map(boxOf).flatMap(({ min, max }) => [min, max].map((corner) => this.toScene(corner).length()))));
      if (this.frameId !== before) this.fit(START);
    }
    this.placeAll();
    this.apply();
    // Also those that an earlier call began to read.
    await Promise.all(wishes.map(({ role }) => this.models.get(role)?.whole));
  }

  /** @param {Wish} wish */
  add({ mesh, role, isBilinear, transform }) {
    const model = new Model(mesh, isBilinear, transform);
    if (this.leaving.has(role)) model.setRange(0, 0);
    this.models.set(role, model);
    this.scene.add(model.group);
    const total = mesh.kind === "points" ? mesh.vertices : Math.max(1, mesh.faces.triangles + mesh.faces.quads);
    this.onProgress(`Reading ${mesh.name || mesh.id}`, 0);
    model.whole = load(model, () => {
      this.apply();
      this.onProgress(model.isWhole ? "" : `Reading ${mesh.name || mesh.id}`, Math.min(1, model.pieces.length * 5e4 / total));
    }).catch((error) => {
      this.onProgress("", 1);
      throw error;
    });
  }

  /** @param {Role} role @param {Model} model */
  startChange(role, model) {
    this.endChange(role);
    forget(model);
    this.leaving.set(role, model);
    this.models.delete(role);
  }

  /** The new model alone is there. @param {Role} role */
  endChange(role) {
    this.leaving.get(role)?.dispose();
    this.leaving.delete(role);
    this.models.get(role)?.setRange(0, Infinity);
    this.draw();
  }

  /** @param {Role} role */
  remove(role) {
    this.endChange(role);
    const model = this.models.get(role);
    if (!model) return;
    forget(model);
    model.dispose();
    this.models.delete(role);
  }

  /** Sees all that is not hidden. @param {Vector3} [side] whence, if not from where one is */
  fit(side = this.eye.side) {
    const all = new Box3();
    for (const wish of this.wishes) {
      const box = boxOf(wish);
      if (!wish.isHidden) for (const corner of [box.min, box.max]) all.expandByPoint(this.toScene(corner));
    }
    if (!all.isEmpty()) this.eye.fit(all.getCenter(new Vector3()), Math.max(all.min.distanceTo(all.max) / 2, 1e-6), side);
  }

  placeAll() {
    for (const model of this.models.values()) model.place(this.frame);
  }

  /** Puts the look into the materials. */
  apply() {
    this.scene.background = new Color(...toVector(colour("--ground")).toArray());
    for (const wish of this.wishes) {
      const model = this.models.get(wish.role);
      if (!model) continue;
      this.dress(model, wish);
      model.group.visible = !wish.isHidden;
    }
    this.draw();
  }

  /** Puts the look into the materials of a model. @param {Model} model @param {{ role: Role, isGhost?: boolean }} wish */
  dress(model, { role, isGhost = false }) {
    const base = toVector(colour(role === "a" ? "--mesh-a" : "--mesh-b"));
    const { surface, discs } = model;
    const isHeated = this.look.heat && role === "a";
    model.plane = this.plane;
    for (const { uniforms } of model.materials()) uniforms.cut.value.fromArray(toUniform(model.plane));
    surface.uniforms.base.value = base;
    surface.uniforms.line.value = toVector(colour("--ink"));
    surface.uniforms.wire.value = this.look.wire ? 1 : 0;
    surface.uniforms.tinted.value = this.look.structure && this.look.patches && model.mesh.patches > 0 ? 1 : 0;
    for (const { uniforms } of [surface, discs]) {
      const { low, high, isSigned, limits } = this.look.scale;
      uniforms.heated.value = isHeated ? 1 : 0;
      uniforms.signed_.value = isSigned ? 1 : 0;
      uniforms.range.value.set(low, high);
      uniforms.banded.value = limits ? 1 : 0;
      if (limits) uniforms.limits.value.set(...limits);
    }
    model.showHeat(isHeated);
    const isClear = isGhost || this.look.through;
    surface.uniforms.opacity.value = isClear ? 0.28 : 1;
    surface.transparent = isClear;
    surface.depthWrite = !isClear;
    discs.uniforms.base.value = base;
    discs.uniforms.radius.value = 1.7 * model.spacing * this.look.disc;
    model.group.renderOrder = isGhost ? 1 : 0;
    if (model.irregular) model.irregular.visible = this.look.structure && this.look.irregular;
  }

  /** @param {Partial<Look>} look */
  setLook(look) {
    Object.assign(this.look, look);
    this.apply();
  }

  /** A point of the meshes' own space in that of the scene. @param {number[]} point */
  toScene(point) {
    return new Vector3(...point.map((value, k) => (value - this.frame.centre[k]) * this.frame.scale));
  }

  /**
   * Shows two points and the line between them; null takes them away.
   * @param {{ from: number[], to: number[] } | null} points
   */
  setPair(points) {
    if (points) this.pair.set(this.toScene(points.from), this.toScene(points.to), toVector(colour("--upper")));
    this.pair.group.visible = points !== null;
    this.draw();
  }

  /** The surfaces that hide what lies behind them. @returns {Model[]} */
  opaqueModels() {
    return this.wishes.filter(({ isHidden, isGhost, mesh }) => !isHidden && !isGhost && mesh.kind !== "points")
      .flatMap(({ role }) => this.models.get(role) ?? []).filter(({ isWhole }) => isWhole);
  }

  /** Draws all surfaces see-through, or as they are. @param {boolean} isOn */
  setThrough(isOn) {
    if (this.look.through === isOn) return;
    this.onThrough(isOn);
  }

  /** Draws over the meshes, in the place of what the same layer had. @param {Drawing} [drawing] @param {string} [layer] */
  setOverlay(drawing = {}, layer = "marks") {
    this.layers.set(layer, drawing);
    const all = [...this.layers.values()];
    this.overlay.set({
      ribbons: all.flatMap(({ ribbons = [] }) => ribbons), dots: all.flatMap(({ dots = [] }) => dots), fills: all.flatMap(({ fills = [] }) => fills),
      isOverCloud: all.some(({ isOverCloud }) => isOverCloud) });
    this.draw();
  }

  /** Where the look cuts; null where it does not. @returns {Plane | null} */
  get plane() {
    const { cut } = this.look;
    if (!cut || this.wishes.length === 0) return null;
    const ends = this.wishes.map(boxOf).flatMap(({ min, max }) => [min, max].map((corner) => this.toScene(corner).getComponent(cut.axis)));
    const [low, high] = [Math.min(...ends), Math.max(...ends)];
    return { axis: cut.axis, at: low + cut.share * (high - low), side: cut.isOther ? -1 : 1 };
  }

  draw() {
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame(() => this.drawWhenFree());
  }

  /** Frames that pile up before a slow graphics card would make the whole page wait. */
  drawWhenFree() {
    if (this.isBusy()) requestAnimationFrame(() => this.drawWhenFree());
    else this.drawNow(PIECES_A_FRAME);
  }

  /** Is the graphics card still at the last frame, or not ready for one? */
  isBusy() {
    return !this.isReady || this.readings > 0 || this.isDrawing();
  }

  /**
   * Reads back what was drawn, four bytes a pixel. Nothing else is drawn meanwhile: the bytes would wait for that, and the page
   * for the bytes.
   * @param {WebGLRenderTarget} target
   */
  async read(target) {
    const bytes = new Uint8Array(4 * target.width * target.height);
    this.readings++;
    try {
      await this.renderer.readRenderTargetPixelsAsync(target, 0, 0, target.width, target.height, bytes);
    } finally {
      this.readings--;
    }
    return bytes;
  }

  isDrawing() {
    const gl = /** @type {WebGL2RenderingContext} */ (this.renderer.getContext());
    return this.last !== null && gl.clientWaitSync(this.last, 0, 0) === gl.TIMEOUT_EXPIRED;
  }

  /** @param {number} [morePieces] of each model at most */
  drawNow(morePieces = Infinity) {
    this.isWaiting = false;
    const others = [...this.models.values()].filter((model) => model.letIn(morePieces));
    this.eye.setPlanes();
    this.setHeight(this.renderer.domElement.height);
    this.renderer.render(this.scene, this.eye.camera);
    this.mark();
    if (others.length > 0) this.draw();
  }

  /** Notes that the graphics card has got something to do. */
  mark() {
    const gl = /** @type {WebGL2RenderingContext} */ (this.renderer.getContext());
    if (this.last) gl.deleteSync(this.last);
    this.last = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** Discs and marks have sizes in pixels. @param {number} height of the picture */
  setHeight(height) {
    for (const model of this.models.values()) {
      for (const { uniforms } of model.materials()) if (uniforms.height) uniforms.height.value = height;
    }
    this.pair.setHeight(height);
  }

  /** Resolves when the graphics card has drawn what it was told to. */
  async rest() {
    while (this.isBusy() || this.isWaiting) await new Promise((resolve) => { requestAnimationFrame(resolve); });
  }

  /** Draws the models alone, without what lies over them. @param {WebGLRenderTarget} target */
  drawBare(target) {
    const extras = [this.overlay.group, this.pair.group].filter((group) => group.visible);
    for (const extra of extras) extra.visible = false;
    this.eye.setPlanes();
    this.setHeight(target.height);
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(this.scene, this.eye.camera);
    this.renderer.setRenderTarget(null);
    for (const extra of extras) extra.visible = true;
    this.mark();
  }

  /** The view as a PNG. @returns {Promise<Blob>} */
  toPng() {
    this.drawNow();
    return new Promise((resolve, reject) => this.canvas.toBlob(
      (blob) => (blob ? resolve(blob) : reject(new Error("the browser made no picture"))), "image/png"));
  }
}

/** @param {Wish} wish */
const boxOf = ({ mesh, transform = null }) => moveBox(mesh.bounding_box, transform);

/** @param {Model} model @param {Wish} wish */
function isSame({ mesh, isBilinear, transform }, wish) {
  return mesh.id === wish.mesh.id && String(transform) === String(wish.transform ?? null) && mesh.revision === wish.mesh.revision && isBilinear === wish.isBilinear;
}

/** A colour "rgb(1, 2, 3)" or "color(srgb 0.1 0.2 0.3)" as numbers from 0 to 1. @param {string} text */
export function toVector(text) {
  const numbers = (text.match(/[\d.]+/g) ?? []).map(Number);
  return new Vector3(...numbers.slice(0, 3)).multiplyScalar(text.startsWith("rgb") ? 1 / 255 : 1);
}
