// How deep the view is: read back from the graphics card when the eye rests, to tell what is in front from what is hidden.

import {
  DepthTexture, GLSL3, Mesh, NearestFilter, OrthographicCamera, PlaneGeometry, Scene, ShaderMaterial, Vector3, WebGLRenderTarget,
} from "three";

/** @import { Stage } from "./stage.js" */

const SHRINK = 3;
/** How far a point may lie behind what is seen at its place, in units of the scene. */
const SLACK = 0.02;
const REST_MS = 120;

const VERTEX = /* glsl */ `
  void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }
`;
const FRAGMENT = /* glsl */ `
  precision highp float;
  uniform highp sampler2D depth;
  out vec4 bytes;
  void main() {
    float value = texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r * 16777215.0;
    bytes = vec4(floor(value / 65536.0), mod(floor(value / 256.0), 256.0), mod(value, 256.0), 255.0) / 255.0;
  }
`;

export class DepthMap {
  /** @param {Stage} stage @param {() => void} onRead called when more is known */
  constructor(stage, onRead) {
    this.stage = stage;
    this.onRead = onRead;
    /** @type {{ width: number, height: number, bytes: Uint8Array, eye: string } | null} */
    this.map = null;
    this.material = new ShaderMaterial({ glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: { depth: { value: null } } });
    this.quad = new Scene();
    this.quad.add(new Mesh(new PlaneGeometry(2, 2), this.material));
    this.flat = new OrthographicCamera();
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.isGone = false;
    this.plan();
    stage.eye.controls.addEventListener("change", this.plan);
  }

  /** Reads again when the eye has rested for a while. */
  plan = () => {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.read(), REST_MS);
  };

  async read() {
    const { stage } = this;
    if (stage.isBusy() || stage.isWaiting) {
      this.plan();
      return;
    }
    const width = Math.max(1, Math.round(stage.canvas.clientWidth / SHRINK));
    const height = Math.max(1, Math.round(stage.canvas.clientHeight / SHRINK));
    const eye = stage.eye.toText();
    const seen = new WebGLRenderTarget(width, height, { minFilter: NearestFilter, magFilter: NearestFilter, depthTexture: new DepthTexture(width, height) });
    const packed = new WebGLRenderTarget(width, height);
    stage.drawBare(seen);
    this.material.uniforms.depth.value = seen.depthTexture;
    stage.renderer.setRenderTarget(packed);
    stage.renderer.render(this.quad, this.flat);
    stage.renderer.setRenderTarget(null);
    const bytes = await stage.read(packed);
    for (const target of [seen, packed]) target.dispose();
    if (this.isGone) return;
    this.map = { width, height, bytes, eye };
    this.onRead();
  }

  /**
   * Is a point in front, as far as is known? Every one is while the eye moves.
   * @param {Vector3} place in the scene
   */
  isSeen(place) {
    const { camera } = this.stage.eye;
    if (!this.map || this.map.eye !== this.stage.eye.toText()) return true;
    const { width, height, bytes } = this.map;
    const on = place.clone().project(camera);
    const [x, y] = [Math.floor(((on.x + 1) / 2) * width), Math.floor(((on.y + 1) / 2) * height)];
    let deepest = 0;
    for (let j = Math.max(0, y - 1); j <= Math.min(height - 1, y + 1); j++) {
      for (let i = Math.max(0, x - 1); i <= Math.min(width - 1, x + 1); i++) {
        const at = 4 * (j * width + i);
        deepest = Math.max(deepest, (bytes[at] * 65536 + bytes[at + 1] * 256 + bytes[at + 2]) / 16777215);
      }
    }
    const { near, far } = camera;
    const reach = (2 * near * far) / (far + near - (2 * deepest - 1) * (far - near));
    return -place.clone().applyMatrix4(camera.matrixWorldInverse).z <= reach + SLACK;
  }

  dispose() {
    this.isGone = true;
    clearTimeout(this.timer);
    this.stage.eye.controls.removeEventListener("change", this.plan);
    this.material.dispose();
  }
}
