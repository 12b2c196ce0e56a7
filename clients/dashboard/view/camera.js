// Where one looks from: turning and zooming by mouse, touch and keys, flights, and a text for links.

import { PerspectiveCamera, Spherical, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const FLIGHT_MS = 600;
const TURN = Math.PI / 24;
/** The side from which one sees at first. */
export const START = new Vector3(0.55, 0.4, 1).normalize();

export class Eye {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {() => void} onChange
   * @param {() => void} onFit when all is to be seen
   */
  constructor(canvas, onChange, onFit) {
    this.camera = new PerspectiveCamera(35, 1, 0.001, 100);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", onChange);
    this.controls.zoomToCursor = true;
    this.controls.minDistance = 1e-4;
    /** How far from the origin there is something to see. */
    this.size = 1;
    this.controls.maxDistance = 50;
    this.onFit = onFit;
    /** The next frame of a flight that has not arrived, else 0. @type {number} */
    this.flight = 0;
    this.fit(new Vector3(), 0.5, START);
    canvas.addEventListener("keydown", (event) => this.onKey(event));
    canvas.addEventListener("pointerdown", () => this.endFlight());
  }

  /** @param {number} size */
  setSize(size) {
    this.size = size;
    this.controls.maxDistance = 50 * size;
  }

  /** Whence one looks. */
  get side() {
    return this.camera.position.clone().sub(this.controls.target).normalize();
  }

  /** Sees all of a ball. @param {Vector3} centre @param {number} radius @param {Vector3} side whence */
  fit(centre, radius, side) {
    const narrow = Math.min(1, this.camera.aspect || 1);
    const distance = (0.98 * radius) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(side, distance);
    this.controls.update();
  }

  /**
   * Flies to look at a point from a distance, from the side where one is, unless a direction is given.
   * @param {Vector3} target
   * @param {number} distance
   * @param {Vector3} [direction]
   */
  flyTo(target, distance, direction) {
    this.endFlight();
    const { camera, controls } = this;
    const from = camera.position.clone();
    const fromTarget = controls.target.clone();
    const side = (direction ?? from.clone().sub(fromTarget)).normalize();
    const to = target.clone().addScaledVector(side, distance);
    const start = performance.now();
    const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const step = (/** @type {number} */ now) => {
      const share = isStill ? 1 : Math.min(1, Math.max(0, (now - start) / FLIGHT_MS));
      const eased = share * share * (3 - 2 * share);
      camera.position.lerpVectors(from, to, eased);
      controls.target.lerpVectors(fromTarget, target, eased);
      controls.update();
      this.flight = share < 1 ? requestAnimationFrame(step) : 0;
    };
    this.flight = requestAnimationFrame(step);
  }

  /** Stays where a flight is. */
  endFlight() {
    cancelAnimationFrame(this.flight);
    this.flight = 0;
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    const turns = /** @type {Record<string, [number, number]>} */ ({
      ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] });
    const zooms = /** @type {Record<string, number>} */ ({ "+": 0.85, "=": 0.85, "-": 1 / 0.85 });
    if (turns[event.key] || zooms[event.key] || event.key === "f") this.endFlight();
    if (turns[event.key] && event.shiftKey) this.move(...turns[event.key]);
    else if (turns[event.key]) this.turn(...turns[event.key]);
    else if (zooms[event.key]) this.zoom(zooms[event.key]);
    else if (event.key === "f") this.onFit();
    else return;
    event.preventDefault();
  }

  /** @param {number} sideways @param {number} upward */
  turn(sideways, upward) {
    const place = new Spherical().setFromVector3(this.camera.position.clone().sub(this.controls.target));
    place.theta += sideways;
    place.phi += upward;
    place.makeSafe();
    this.camera.position.setFromSpherical(place).add(this.controls.target);
    this.controls.update();
  }

  /** Moves what is seen the way of an arrow, by a part of the view. @param {number} sideways @param {number} upward */
  move(sideways, upward) {
    const { camera, controls } = this;
    camera.updateMatrix();
    const reach = camera.position.distanceTo(controls.target);
    const by = new Vector3().setFromMatrixColumn(camera.matrix, 0).multiplyScalar(-sideways * reach)
      .addScaledVector(new Vector3().setFromMatrixColumn(camera.matrix, 1), upward * reach);
    camera.position.add(by);
    controls.target.add(by);
    controls.update();
  }

  /** @param {number} factor */
  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }

  /** Position and target, in units of the scene. */
  toText() {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray()].map((x) => Number(x.toPrecision(7))).join(",");
  }

  /** @param {string} text */
  fromText(text) {
    const numbers = text.split(",").map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return;
    this.camera.position.fromArray(numbers);
    this.controls.target.fromArray(numbers, 3);
    this.controls.update();
  }

  /** Planes that are as near and far as they must be. */
  setPlanes() {
    const distance = this.camera.position.length();
    const reach = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.max(reach / 100, distance - 2 * this.size, 1e-6);
    this.camera.far = distance + 2 * this.size;
    this.camera.updateProjectionMatrix();
  }
}
