// Two points and the line between them. What the surfaces hide of them is drawn over these, hollow and dashed.

import {
  BufferAttribute, BufferGeometry, GLSL3, GreaterDepth, Group, Line, LineBasicMaterial, LineDashedMaterial, Points, ShaderMaterial, Vector3,
} from "three";

/** @import { Scene } from "three" */

// Somewhat nearer to the viewer than the surface that they lie on.
const VERTEX = /* glsl */ `
  uniform float height;
  void main() {
    gl_Position = projectionMatrix * vec4((modelViewMatrix * vec4(position, 1.0)).xyz * 0.997, 1.0);
    gl_PointSize = max(11.0, height / 70.0);
  }
`;
const FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 base;
  uniform float hollow;
  out vec4 colour;
  void main() {
    float r = length(2.0 * gl_PointCoord - 1.0);
    if (r > 1.0 || (hollow > 0.5 && r < 0.6)) discard;
    colour = vec4(hollow < 0.5 && r > 0.7 ? vec3(1.0) : base, 1.0);
  }
`;

/** How long the dashes of the hidden part of the line are, as a share of it. */
const DASH = 1 / 24;

export class Pair {
  /** @param {Scene} scene */
  constructor(scene) {
    this.group = new Group();
    this.group.visible = false;
    this.from = new Vector3();
    this.to = new Vector3();
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    const ends = (/** @type {number} */ hollow) => new ShaderMaterial({
      glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, transparent: true, depthWrite: false,
      uniforms: { base: { value: new Vector3() }, height: { value: 1 }, hollow: { value: hollow } },
    });
    this.line = new LineBasicMaterial({ transparent: true, depthWrite: false });
    this.dashes = new LineDashedMaterial({ transparent: true, depthWrite: false, depthFunc: GreaterDepth });
    this.ends = ends(0);
    this.hiddenEnds = ends(1);
    this.hiddenEnds.depthFunc = GreaterDepth;
    this.drawnDashes = new Line(this.geometry, this.dashes);
    for (const drawn of [new Line(this.geometry, this.line), this.drawnDashes, new Points(this.geometry, this.ends), new Points(this.geometry, this.hiddenEnds)]) {
      drawn.frustumCulled = false;
      drawn.renderOrder = 5;
      this.group.add(drawn);
    }
    scene.add(this.group);
  }

  /** @param {Vector3} from @param {Vector3} to @param {Vector3} base a colour */
  set(from, to, base) {
    this.from.copy(from);
    this.to.copy(to);
    const position = this.geometry.getAttribute("position");
    position.setXYZ(0, from.x, from.y, from.z);
    position.setXYZ(1, to.x, to.y, to.z);
    position.needsUpdate = true;
    this.dashes.dashSize = this.dashes.gapSize = DASH * from.distanceTo(to);
    this.drawnDashes.computeLineDistances();
    for (const { color } of [this.line, this.dashes]) color.setRGB(base.x, base.y, base.z);
    for (const { uniforms } of [this.ends, this.hiddenEnds]) uniforms.base.value = base;
  }

  /** @param {number} height of the picture */
  setHeight(height) {
    for (const { uniforms } of [this.ends, this.hiddenEnds]) uniforms.height.value = height;
  }
}
