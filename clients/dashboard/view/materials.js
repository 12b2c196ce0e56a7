// How surfaces and points are shaded. Colours are those of the screen from the start, not linear ones.

import { Data3DTexture, DataTexture, DoubleSide, GLSL3, LinearFilter, RGBAFormat, ShaderMaterial, Vector2, Vector3, Vector4 } from "three";

import { scaleTables } from "./colours.js";
import { BANDS } from "./scale.js";

const LIGHT = /* glsl */ `
  vec3 shade(vec3 base, vec3 n, float strength) {
    float key = 0.5 + 0.5 * dot(n, normalize(vec3(0.35, 0.6, 0.7)));
    float fill = max(dot(n, normalize(vec3(-0.8, 0.0, 0.5))), 0.0);
    float shine = pow(max(dot(n, normalize(vec3(0.25, 0.35, 0.95))), 0.0), 40.0);
    return mix(base, base * (0.3 + 0.78 * key * key + 0.12 * fill), strength) + 0.06 * shine * strength;
  }
`;

// Colours of cells, premultiplied, so that a mixture with cells that have none is the colour itself.
const REGION = /* glsl */ `
  precision highp sampler3D;
  uniform float regioned;
  uniform sampler3D regions;
  uniform vec3 regionLow;
  uniform vec3 regionSize;
  vec3 inRegion(vec3 base, vec3 place) {
    if (regioned < 0.5) return base;
    vec4 found = texture(regions, (place - regionLow) / regionSize);
    return found.a < 0.01 ? base : mix(base, found.rgb / found.a, 0.8 * smoothstep(0.25, 0.5, found.a));
  }
`;

const SURFACE_VERTEX = /* glsl */ `
  in vec4 edge;
  in vec4 tint;
  in vec2 value;
  out vec3 vNormal;
  out vec3 vEdge;
  out vec3 vTint;
  out vec2 vValue;
  out vec3 vPlace;
  out vec3 vScene;
  void main() {
    vPlace = position;
    vScene = (modelMatrix * vec4(position, 1.0)).xyz;
    vNormal = normalMatrix * normal;
    vEdge = edge.xyz;
    vTint = tint.rgb;
    vValue = value;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }
`;

// From blue to yellow; of signed values from blue over the grey of 0 to red. Or bands: a value is in one for certain when it is by
// more than it may be off.
const HEAT = /* glsl */ `
  uniform float heated;
  uniform float signed_;
  uniform float banded;
  uniform vec2 range;
  uniform vec2 limits;
  uniform vec3 bands[4];
  uniform sampler2D scale;
  vec3 inBand(vec2 value) {
    vec2 span = value.x + vec2(-value.y, value.y);
    if (span.y < limits.x) return bands[0];
    if (span.x > limits.y) return bands[2];
    return span.x >= limits.x && span.y <= limits.y ? bands[1] : bands[3];
  }
  vec3 inHeat(vec3 base, vec2 value) {
    if (heated < 0.5) return base;
    if (banded > 0.5) return inBand(value);
    float share = (value.x - range.x) / (range.y - range.x);
    if (signed_ > 0.5) share = value.x < 0.0 ? 0.5 - 0.5 * value.x / range.x : 0.5 + 0.5 * value.x / range.y;
    return texture(scale, vec2((clamp(share, 0.0, 1.0) * 255.0 + 0.5) / 256.0, signed_ > 0.5 ? 0.75 : 0.25)).rgb;
  }
`;

// What a section takes away.
const CUT = /* glsl */ `
  uniform vec4 cut;
  in vec3 vScene;
  bool isCut() { return dot(vScene, cut.xyz) > cut.w; }
`;

const SURFACE_FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 base;
  uniform vec3 line;
  uniform float opacity;
  uniform float wire;
  uniform float tinted;
  in vec3 vNormal;
  in vec3 vEdge;
  in vec3 vTint;
  in vec2 vValue;
  in vec3 vPlace;
  out vec4 colour;
  ${LIGHT}
  ${REGION}
  ${HEAT}
  ${CUT}
  void main() {
    if (isCut()) discard;
    vec3 n = normalize(vNormal);
    if (!gl_FrontFacing) n = -n;
    vec3 flat_colour = inRegion(mix(base, vTint, tinted), vPlace);
    if (!gl_FrontFacing) flat_colour = mix(flat_colour, vec3(dot(flat_colour, vec3(0.33))), 0.6) * 0.85;
    flat_colour = inHeat(flat_colour, vValue);
    vec3 lit = shade(flat_colour, n, heated > 0.5 ? 0.6 : 1.0);
    vec3 width = fwidth(vEdge);
    vec3 clear = smoothstep(0.35 * width, 1.25 * width, vEdge);
    float far = smoothstep(0.2, 0.7, max(width.x, max(width.y, width.z)));
    float drawn = wire * (1.0 - min(clear.x, min(clear.y, clear.z))) * mix(0.8, 0.25, far);
    colour = vec4(mix(lit, line, drawn), opacity);
  }
`;

const DISC_VERTEX = /* glsl */ `
  uniform float radius;
  uniform float height;
  uniform float least;
  uniform float lift;
  in vec4 facing;
  in vec2 value;
  out vec3 vNormal;
  out vec2 vValue;
  out vec3 vPlace;
  out vec3 vScene;
  void main() {
    vPlace = position;
    vScene = (modelMatrix * vec4(position, 1.0)).xyz;
    vNormal = normalMatrix * facing.xyz;
    vValue = value;
    vec4 place = modelViewMatrix * vec4(position, 1.0);
    place.xyz *= 1.0 - lift;
    gl_Position = projectionMatrix * place;
    float size = length(modelViewMatrix[0].xyz) * radius * height * projectionMatrix[1][1] / gl_Position.w;
    gl_PointSize = max(least, size);
  }
`;

// A disc seen at an angle is an ellipse: what of the square lies over the disc's plane within its radius.
const DISC_FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 base;
  in vec3 vNormal;
  in vec3 vPlace;
  in vec2 vValue;
  out vec4 colour;
  ${LIGHT}
  ${REGION}
  ${HEAT}
  ${CUT}
  void main() {
    if (isCut()) discard;
    vec2 place = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
    vec3 n = dot(vNormal, vNormal) > 0.01 ? normalize(vNormal) : vec3(0.0, 0.0, 1.0);
    if (n.z < 0.0) n = -n;
    float depth = -dot(n.xy, place) / max(n.z, 0.15);
    if (dot(place, place) + depth * depth > 1.0) discard;
    colour = vec4(shade(inHeat(inRegion(base, vPlace), vValue), n, heated > 0.5 ? 0.6 : 1.0), 1.0);
  }
`;

const MARK_FRAGMENT = /* glsl */ `
  precision highp float;
  uniform vec3 low;
  uniform vec3 high;
  uniform vec3 ring;
  in vec3 vNormal;
  in vec2 vValue;
  out vec4 colour;
  ${CUT}
  void main() {
    float r = length(2.0 * gl_PointCoord - 1.0);
    if (r > 1.0 || isCut()) discard;
    colour = vec4(r > 0.72 ? ring : (vValue.x < 4.0 ? low : high), 1.0);
  }
`;

/** @type {DataTexture | undefined} */
let scaleTexture;
function scale() {
  if (!scaleTexture) {
    scaleTexture = new DataTexture(scaleTables(), 256, 2, RGBAFormat);
    scaleTexture.minFilter = scaleTexture.magFilter = LinearFilter;
    scaleTexture.needsUpdate = true;
  }
  return scaleTexture;
}

const heatUniforms = () => ({
  heated: { value: 0 }, signed_: { value: 0 }, banded: { value: 0 }, range: { value: new Vector2(0, 1) }, limits: { value: new Vector2() },
  bands: { value: BANDS.map((band) => new Vector3(...band)) }, scale: { value: scale() } });

/** @param {Uint8Array} colours rows of r, g, b, a @param {number[]} sides */
export function makeRegions(colours, [width, height, depth]) {
  const texture = new Data3DTexture(colours, width, height, depth);
  texture.format = RGBAFormat;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

const cutUniforms = () => ({ cut: { value: new Vector4(0, 0, 0, 1) } });

/** @type {Data3DTexture | undefined} */
let noRegions;
function regionUniforms() {
  noRegions ??= makeRegions(new Uint8Array(4), [1, 1, 1]);
  return { regioned: { value: 0 }, regions: { value: noRegions }, regionLow: { value: new Vector3() }, regionSize: { value: new Vector3(1, 1, 1) } };
}

export function makeSurface() {
  return new ShaderMaterial({
    glslVersion: GLSL3, vertexShader: SURFACE_VERTEX, fragmentShader: SURFACE_FRAGMENT, side: DoubleSide,
    uniforms: {
      base: { value: new Vector3() }, line: { value: new Vector3() }, opacity: { value: 1 }, wire: { value: 0 },
      tinted: { value: 0 }, ...cutUniforms(), ...heatUniforms(), ...regionUniforms(),
    },
  });
}

export function makeDiscs() {
  return new ShaderMaterial({
    glslVersion: GLSL3, vertexShader: DISC_VERTEX, fragmentShader: DISC_FRAGMENT,
    uniforms: { base: { value: new Vector3() }, radius: { value: 0 }, height: { value: 1 }, least: { value: 1.5 },
      lift: { value: 0 }, ...cutUniforms(), ...heatUniforms(), ...regionUniforms() },
  });
}

/** Marks of irregular vertices: one colour below valence four, one above. */
export function makeMarks() {
  return new ShaderMaterial({
    glslVersion: GLSL3, vertexShader: DISC_VERTEX, fragmentShader: MARK_FRAGMENT, depthTest: true,
    uniforms: {
      radius: { value: 0 }, height: { value: 1 }, least: { value: 9 }, ...cutUniforms(),
      lift: { value: 0.004 }, low: { value: new Vector3(0.15, 0.45, 0.95) },
      high: { value: new Vector3(0.9, 0.2, 0.2) }, ring: { value: new Vector3(1, 1, 1) },
    },
  });
}
