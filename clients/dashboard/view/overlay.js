// What is drawn over the meshes: ribbons along curves, dots, and fills. Everything is given in scene coordinates.

import {
  BufferAttribute, BufferGeometry, DoubleSide, GLSL3, GreaterDepth, Group, Mesh, Points, ShaderMaterial, Vector2, Vector3,
} from "three";

/** @import { Scene } from "three" */
/** @typedef {{ points: Vector3[], colour: Vector3, width: number }} Ribbon width in pixels */
/** @typedef {{ point: Vector3, colour: Vector3, size: number, isMark?: boolean }} Dot size in pixels; isMark: drawn hollow where it is hidden */
/** @typedef {{ triangles: Float32Array, colour: Vector3, opacity: number }} Fill nine numbers a triangle */
/** @typedef {{ ribbons?: Ribbon[], dots?: Dot[], fills?: Fill[], isOverCloud?: boolean }} Drawing */

// Somewhat nearer to the viewer than the surface that it lies on, or than the discs round its points: shares of the distance.
const LIFT = 0.003;
const CLOUD_LIFT = 0.015;

const RIBBON_VERTEX = /* glsl */ `
  uniform vec2 size;
  uniform float lift;
  in vec3 next;
  in vec3 tint;
  in vec2 side;
  out vec3 vTint;
  void main() {
    vTint = tint;
    vec4 here = projectionMatrix * vec4((modelViewMatrix * vec4(position, 1.0)).xyz * (1.0 - lift), 1.0);
    vec4 there = projectionMatrix * vec4((modelViewMatrix * vec4(next, 1.0)).xyz * (1.0 - lift), 1.0);
    vec2 along = (there.xy / there.w - here.xy / here.w) * size;
    along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
    here.xy += (vec2(-along.y, along.x) * side.x - along * abs(side.x) * 0.4) * side.y / size * here.w;
    gl_Position = here;
  }
`;
const DOT_VERTEX = /* glsl */ `
  uniform float lift;
  in vec3 tint;
  in float size;
  out vec3 vTint;
  void main() {
    vTint = tint;
    gl_Position = projectionMatrix * vec4((modelViewMatrix * vec4(position, 1.0)).xyz * (1.0 - 1.5 * lift), 1.0);
    gl_PointSize = size;
  }
`;
const FILL_VERTEX = /* glsl */ `
  uniform float lift;
  void main() {
    gl_Position = projectionMatrix * vec4((modelViewMatrix * vec4(position, 1.0)).xyz * (1.0 - lift), 1.0);
  }
`;
const PLAIN_FRAGMENT = /* glsl */ `
  precision highp float;
  in vec3 vTint;
  out vec4 colour;
  void main() { colour = vec4(vTint, 1.0); }
`;
const DOT_FRAGMENT = /* glsl */ `
  precision highp float;
  uniform float hollow;
  in vec3 vTint;
  out vec4 colour;
  void main() {
    float r = length(2.0 * gl_PointCoord - 1.0);
    if (r > 1.0 || (hollow > 0.5 && r < 0.6)) discard;
    colour = vec4(hollow < 0.5 && r > 0.68 ? vec3(1.0) : vTint, 1.0);
  }
`;
const FILL_FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 base;
  uniform float opacity;
  out vec4 colour;
  void main() { colour = vec4(base, opacity); }
`;

/** @param {string} vertexShader @param {string} fragmentShader @param {Record<string, { value: any }>} uniforms */
const material = (vertexShader, fragmentShader, uniforms = {}) =>
  new ShaderMaterial({ glslVersion: GLSL3, vertexShader, fragmentShader, uniforms, side: DoubleSide });

export class Overlay {
  /** @param {Scene} scene */
  constructor(scene) {
    this.group = new Group();
    this.group.renderOrder = 3;
    scene.add(this.group);
    this.size = new Vector2(1, 1);
    this.lift = { value: LIFT };
    this.ribbon = material(RIBBON_VERTEX, PLAIN_FRAGMENT, { size: { value: this.size }, lift: this.lift });
    this.dot = material(DOT_VERTEX, DOT_FRAGMENT, { lift: this.lift, hollow: { value: 0 } });
    this.hiddenDot = material(DOT_VERTEX, DOT_FRAGMENT, { lift: this.lift, hollow: { value: 1 } });
    this.hiddenDot.depthFunc = GreaterDepth;
    this.hiddenDot.depthWrite = false;
  }

  /**
   * @param {Drawing} [drawing] what is left out is not there any more
   */
  set({ ribbons = [], dots = [], fills = [], isOverCloud = false } = {}) {
    this.lift.value = isOverCloud ? CLOUD_LIFT : LIFT;
    for (const child of [...this.group.children]) {
      const drawn = /** @type {Mesh} */ (child);
      drawn.geometry.dispose();
      if (![this.ribbon, this.dot, this.hiddenDot].includes(/** @type {ShaderMaterial} */ (drawn.material))) /** @type {ShaderMaterial} */ (drawn.material).dispose();
      child.removeFromParent();
    }
    for (const fill of fills) this.add(new Mesh(geometryOf({ position: [fill.triangles, 3] }), fillMaterial(fill)), 2);
    if (ribbons.length > 0) this.add(new Mesh(ribbonGeometry(ribbons), this.ribbon), 3);
    if (dots.length > 0) this.add(new Points(dotGeometry(dots), this.dot), 4);
    const marks = dots.filter(({ isMark }) => isMark);
    if (marks.length > 0) this.add(new Points(dotGeometry(marks), this.hiddenDot), 4);
  }

  /** @param {Mesh | Points} drawn @param {number} order */
  add(drawn, order) {
    drawn.frustumCulled = false;
    drawn.renderOrder = order;
    this.group.add(drawn);
  }
}

/** @param {Fill} fill */
function fillMaterial({ colour, opacity }) {
  const made = material(FILL_VERTEX, FILL_FRAGMENT, { base: { value: colour }, opacity: { value: opacity }, lift: { value: LIFT / 2 } });
  made.transparent = opacity < 1;
  made.depthWrite = false;
  return made;
}

/** @param {Record<string, [Float32Array, number]>} attributes */
function geometryOf(attributes) {
  const geometry = new BufferGeometry();
  for (const [name, [array, width]] of Object.entries(attributes)) geometry.setAttribute(name, new BufferAttribute(array, width));
  return geometry;
}

/** Two triangles for each piece of a curve. @param {Ribbon[]} ribbons */
function ribbonGeometry(ribbons) {
  const pieces = ribbons.reduce((sum, { points }) => sum + points.length - 1, 0);
  const position = new Float32Array(18 * pieces), next = new Float32Array(18 * pieces);
  const tint = new Float32Array(18 * pieces), side = new Float32Array(12 * pieces);
  let at = 0;
  for (const { points, colour, width } of ribbons) {
    for (let i = 0; i + 1 < points.length; i++) {
      // Seen from the far end left and right change places.
      for (const [end, hand] of [[0, 1], [0, -1], [1, 1], [1, 1], [1, -1], [0, 1]]) {
        points[i + end].toArray(position, 3 * at);
        points[i + 1 - end].toArray(next, 3 * at);
        colour.toArray(tint, 3 * at);
        side.set([hand, width], 2 * at);
        at++;
      }
    }
  }
  return geometryOf({ position: [position, 3], next: [next, 3], tint: [tint, 3], side: [side, 2] });
}

/** @param {Dot[]} dots */
function dotGeometry(dots) {
  return geometryOf({
    position: [Float32Array.from(dots.flatMap(({ point }) => point.toArray())), 3],
    tint: [Float32Array.from(dots.flatMap(({ colour }) => colour.toArray())), 3],
    size: [Float32Array.from(dots, ({ size }) => size), 1],
  });
}
