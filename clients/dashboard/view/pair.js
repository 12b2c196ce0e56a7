// Two points and the line between them, drawn over everything.

import {
  BufferAttribute, BufferGeometry, GLSL3, Group, Line, LineBasicMaterial, Points, ShaderMaterial, Vector3,
} from "three";

/** @import { Scene } from "three" */

const VERTEX = /* glsl */ `
  uniform float height;
  void main() {
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    gl_PointSize = max(11.0, height / 70.0);
  }
`;
const FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 base;
  out vec4 colour;
  void main() {
    float r = length(2.0 * gl_PointCoord - 1.0);
    if (r > 1.0) discard;
    colour = vec4(r > 0.7 ? vec3(1.0) : base, 1.0);
  }
`;

export class Pair {
  /** @param {Scene} scene */
  constructor(scene) {
    this.group = new Group();
    this.group.visible = false;
    this.group.renderOrder = 5;
    this.from = new Vector3();
    this.to = new Vector3();
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.line = new LineBasicMaterial({ depthTest: false, transparent: true });
    this.ends = new ShaderMaterial({
      glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, depthTest: false, transparent: true,
      uniforms: { base: { value: new Vector3() }, height: { value: 1 } },
    });
    for (const drawn of [new Line(this.geometry, this.line), new Points(this.geometry, this.ends)]) {
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
    this.line.color.setRGB(base.x, base.y, base.z);
    this.ends.uniforms.base.value = base;
  }

  /** @param {number} height of the picture */
  setHeight(height) {
    this.ends.uniforms.height.value = height;
  }
}
