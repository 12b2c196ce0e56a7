// Colours that mean something: a scale for distances, and tints that tell neighbouring patches apart.

/**
 * OKLab to sRGB (Ottosson 2020), with what lies outside cut off.
 * @param {number} lightness
 * @param {number} a
 * @param {number} b
 * @returns {[number, number, number]} from 0 to 1
 */
export function fromOklab(lightness, a, b) {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const linear = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  const encode = (/** @type {number} */ x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
  return /** @type {[number, number, number]} */ (linear.map((x) => Math.max(0, Math.min(1, encode(Math.max(0, x))))));
}

/**
 * The scale of distances: lightness grows evenly from 0 to 1, so that equal steps look equal, also without colour vision;
 * the hue turns from blue over magenta to yellow.
 * @param {number} share from 0 to 1
 */
export function scaleColour(share) {
  const hue = ((265 + 195 * share) * Math.PI) / 180;
  const chroma = 0.06 + 0.36 * share * (1 - share) + 0.07 * share;
  return fromOklab(0.34 + 0.6 * share, chroma * Math.cos(hue), chroma * Math.sin(hue));
}

/**
 * The scale of signed distances: a light grey in the middle, blue below and red above, alike in lightness on both sides.
 * @param {number} share from 0 to 1
 */
export function signedColour(share) {
  const away = Math.abs(2 * share - 1);
  const hue = ((share < 0.5 ? 250 : 30) * Math.PI) / 180;
  const chroma = 0.17 * away ** 0.8;
  return fromOklab(0.93 - 0.45 * away, chroma * Math.cos(hue), chroma * Math.sin(hue));
}

/** Both scales, one after the other, as rows of r, g, b, a. */
export function scaleTables(steps = 256) {
  const table = new Uint8Array(8 * steps);
  [scaleColour, signedColour].forEach((scale, row) => {
    for (let i = 0; i < steps; i++) table.set([...scale(i / (steps - 1)).map((x) => Math.round(255 * x)), 255], 4 * (row * steps + i));
  });
  return table;
}

/**
 * The tint of a patch: hues by the golden angle, so that patches of near places differ.
 * @param {number} place
 * @returns {number[]} from 0 to 255
 */
export function patchTint(place) {
  const hue = place * Math.PI * (3 - Math.sqrt(5));
  const lightness = 0.76 + 0.1 * ((place * 0.754877666) % 1 - 0.5);
  return fromOklab(lightness, 0.105 * Math.cos(hue), 0.105 * Math.sin(hue)).map((x) => Math.round(255 * x));
}
