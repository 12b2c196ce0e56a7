// Cuts a surface into triangles so small that the distance from another surface is nearly linear over each, and says how far it
// may be from that. Vertices alone tell nothing of what lies between them: a coarse mesh whose vertices lie on a scan is at
// distance 0 there and nowhere else.
//
// Over a triangle with corners v_i, distances d_i from B, and nearest points f_i of B, let p = sum w_i v_i, l = sum w_i d_i, and d
// the distance of p. For corners i and j write V = |v_i - v_j|^2, D = (d_i - d_j)^2, F = (f_i - f_j).(v_i - v_j). Then
//   |d - l| <= sum w_i |p - v_i| <= sqrt(sum_ij w_i w_j V) <= sqrt(max V / 3),                                             (1)
// for d grows no faster than p moves, and the sum of w_i w_j over the three pairs is at most 1/3. Further |p|^2 - d^2 =
// max over b in B of 2 p.b - |b|^2 is convex in p: linear interpolation of it is too high, its tangents at v_i (those of b = f_i)
// too low. In terms of d^2, with l^2 = sum w_i d_i^2 - sum_ij w_i w_j D:
//   d^2 >= l^2 - sum_ij w_i w_j (V - D)      >= l^2 - low,   low  = max(V - D, 0) / 3,                                     (2)
//   d^2 <= l^2 + sum_ij w_i w_j (2F - V + D) <= l^2 + high,  high = max(2F - V + D, 0) / 3,                                (3)
// so l - d <= low / l, d - l <= high / 2l and d - l <= sqrt(high). When all f_i lie on one convex face, d <= the distance of that
// face, which is convex: d <= l. And l - d <= l in any case.

/** @import { FlatFaces } from "./flat.js" */
/** @typedef {{ distance: Float64Array<ArrayBuffer>, foot: Float64Array<ArrayBuffer>, face: Int32Array<ArrayBuffer> }} Feet of points: distance from B, nearest point, its face */
/** @typedef {(points: Float64Array<ArrayBuffer>) => Promise<Feet>} Measure */
/** @typedef {{ target: number, most: number, flat: FlatFaces | null, isSigned: boolean, isWanted: () => boolean }} Limits
 *   target: the error that is good enough; most: triangles; flat: the faces of B, where they are at hand; isSigned: of the signed distance; isWanted: go on? */

/** Of the worst error: triangles with less wait for a later round. */
const SHARE_OF_WORST = 0.5;
/** Of the longest side: shorter ones are not cut. */
const LONG_SIDE = 0.7;
/** What distances from the daemon may be off by, as a share of the coordinates: some hundred roundings. */
const ROUNDING = 2 ** -44;
/** More points than this have no numbers of their own within a side's key. */
const KEY = 2 ** 26;
/** With room for fewer triangles than this share of all, another round is not worth it. */
const LEAST_ROOM = 0.05;

export class Refined {
  /**
   * @param {Float64Array<ArrayBuffer>} points rows of x, y, z
   * @param {Uint32Array} corners three a triangle
   */
  constructor(points, corners) {
    this.points = points;
    this.corners = corners;
    const count = corners.length / 3;
    /** Is there a triangle that is no more whole? */
    this.isCut = false;
    /** The triangle that each one is a part of, in their order. */
    this.origins = Uint32Array.from({ length: count }, (_, place) => place);
    /** Where its corners lie in that triangle: the weights of the second and third corner, six numbers a triangle. */
    this.places = new Float32Array(6 * count);
    for (let at = 0; at < this.places.length; at += 6) this.places[at + 2] = this.places[at + 5] = 1;
    /** @type {Feet} */
    this.feet = { distance: new Float64Array(0), foot: new Float64Array(0), face: new Int32Array(0) };
    /** How far linear interpolation may be off over each triangle. */
    this.errors = new Float64Array(0);
  }

  get count() {
    return this.origins.length;
  }

  /** What distances may be off by, for their rounding. */
  get slack() {
    let most = 0;
    for (const row of [this.points, this.feet.foot]) for (let at = 0; at < row.length; at++) most = Math.max(most, Math.abs(row[at]));
    return ROUNDING * most;
  }

  /** Is a triangle surely away from B? @param {number} t @param {number} slack */
  isClear(t, slack) {
    const { distance } = this.feet;
    return Math.min(distance[this.corners[3 * t]], distance[this.corners[3 * t + 1]], distance[this.corners[3 * t + 2]]) > this.errors[t] + slack;
  }

  /**
   * How far linear interpolation of the signed distance may be off over a triangle. One that is surely away from B lies on one side of it;
   * another one may pass through: the signed distance grows no faster than its place moves, and neither it nor what is shown is larger
   * than the distances are.
   * @param {number} t @param {number} slack
   */
  signedErrorOf(t, slack) {
    return this.isClear(t, slack) ? this.errors[t] : Math.min(this.reachOf(t), this.eitherErrorOf(t));
  }

  /** The same where the side of the corners is not known either. @param {number} t */
  eitherErrorOf(t) {
    const { distance } = this.feet;
    return 2 * Math.max(distance[this.corners[3 * t]], distance[this.corners[3 * t + 1]], distance[this.corners[3 * t + 2]]) + this.errors[t];
  }

  /**
   * Cuts the triangles with the greatest errors until all are small enough or there are enough of them.
   * @param {Measure} measure
   * @param {Limits} limits
   */
  async refine(measure, limits) {
    if (this.errors.length === 0) {
      if (this.feet.distance.length === 0) this.feet = await measure(this.points);
      this.errors = Float64Array.from({ length: this.count }, (_, place) => this.errorOf(place, limits.flat));
    }
    while (limits.isWanted()) {
      const middles = this.findMiddles(limits);
      if (middles.size === 0) return;
      await this.addMiddles(middles, measure);
      this.split(middles, limits.flat);
    }
  }

  /**
   * The sides to be cut, and the number of the new point on each.
   * @param {Limits} limits
   * @returns {Map<number, number>}
   */
  findMiddles({ target, most, isSigned }) {
    const { slack } = this;
    const errors = isSigned ? this.errors.map((_, place) => this.signedErrorOf(place, slack)) : this.errors;
    const bar = Math.max(target, SHARE_OF_WORST * errors.reduce((worst, error) => Math.max(worst, error), 0));
    /** @type {number[]} */
    let bad = [];
    errors.forEach((error, place) => { if (error > bar) bad.push(place); });
    const room = Math.floor((most - this.count) / 3);
    if (3 * room < LEAST_ROOM * most) return new Map();
    if (bad.length > room) bad = bad.sort((one, other) => errors[other] - errors[one]).slice(0, room);
    /** @type {Map<number, number>} */
    const middles = new Map();
    const known = this.points.length / 3;
    for (const place of bad) {
      const sides = [0, 1, 2].map((k) => this.squareOf(this.corners[3 * place + k], this.corners[3 * place + ((k + 1) % 3)]));
      const least = LONG_SIDE ** 2 * Math.max(...sides);
      sides.forEach((square, k) => {
        const key = this.sideKey(3 * place + k, 3 * place + ((k + 1) % 3));
        if (square > 0 && square >= least && !middles.has(key)) middles.set(key, known + middles.size);
      });
    }
    return middles;
  }

  /** @param {number} one place of a corner @param {number} other */
  sideKey(one, other) {
    const [a, b] = [this.corners[one], this.corners[other]];
    return a < b ? a * KEY + b : b * KEY + a;
  }

  /** The square of the distance of two points. @param {number} a @param {number} b */
  squareOf(a, b) {
    const { points } = this;
    return (points[3 * a] - points[3 * b]) ** 2 + (points[3 * a + 1] - points[3 * b + 1]) ** 2 + (points[3 * a + 2] - points[3 * b + 2]) ** 2;
  }

  /** @param {Map<number, number>} middles @param {Measure} measure */
  async addMiddles(middles, measure) {
    const known = this.points.length / 3;
    const added = new Float64Array(3 * middles.size);
    for (const [key, vertex] of middles) {
      const [a, b] = [Math.floor(key / KEY), key % KEY];
      for (let k = 0; k < 3; k++) added[3 * (vertex - known) + k] = this.points[3 * a + k] / 2 + this.points[3 * b + k] / 2;
    }
    const feet = await measure(added);
    this.points = joined(this.points, added);
    this.feet = { distance: joined(this.feet.distance, feet.distance), foot: joined(this.feet.foot, feet.foot), face: joined(this.feet.face, feet.face) };
  }

  /** Puts the parts of each triangle in its place. @param {Map<number, number>} middles @param {FlatFaces | null} flat */
  split(middles, flat) {
    const before = { corners: this.corners, origins: this.origins, places: this.places, errors: this.errors };
    const isEnd = new Uint8Array(this.points.length / 3);
    for (const key of middles.keys()) isEnd[Math.floor(key / KEY)] = isEnd[key % KEY] = 1;
    const ends = (/** @type {number} */ t) => isEnd[before.corners[3 * t]] + isEnd[before.corners[3 * t + 1]] + isEnd[before.corners[3 * t + 2]];
    const most = this.count + 2 * middles.size; // a side has two triangles, and each one more part for it; others have it alone
    let now = { corners: new Uint32Array(3 * most), origins: new Uint32Array(most), places: new Float32Array(6 * most), errors: new Float64Array(most) };
    /** @type {number[]} */
    const fresh = [];
    let n = 0;
    for (let t = 0; t < before.origins.length; t++) {
      const parts = ends(t) < 2 ? null : this.partsOf(t, middles);
      if (n + 4 > now.origins.length) now = grown(now);
      if (!parts) {
        now.corners.set(before.corners.subarray(3 * t, 3 * t + 3), 3 * n);
        now.places.set(before.places.subarray(6 * t, 6 * t + 6), 6 * n);
        now.errors[n] = before.errors[t];
        now.origins[n++] = before.origins[t];
        continue;
      }
      for (const part of parts) {
        part.forEach(({ vertex, place: [second, third] }, k) => {
          now.corners[3 * n + k] = vertex;
          now.places[6 * n + 2 * k] = second;
          now.places[6 * n + 2 * k + 1] = third;
        });
        fresh.push(n);
        now.origins[n++] = before.origins[t];
      }
    }
    this.isCut = true;
    this.corners = now.corners.slice(0, 3 * n);
    this.origins = now.origins.slice(0, n);
    this.places = now.places.slice(0, 6 * n);
    this.errors = now.errors.slice(0, n);
    for (const t of fresh) this.errors[t] = this.errorOf(t, flat);
  }

  /**
   * A triangle cut at the middles of its sides: four triangles, three or two; null when there is none to cut at.
   * @param {number} t
   * @param {Map<number, number>} middles
   */
  partsOf(t, middles) {
    if ([0, 1, 2].every((k) => !middles.has(this.sideKey(3 * t + k, 3 * t + ((k + 1) % 3))))) return null;
    const ends = [0, 1, 2].map((k) => ({ vertex: this.corners[3 * t + k], place: [this.places[6 * t + 2 * k], this.places[6 * t + 2 * k + 1]] }));
    const cuts = [0, 1, 2].map((k) => {
      const vertex = middles.get(this.sideKey(3 * t + k, 3 * t + ((k + 1) % 3)));
      const [here, there] = [ends[k].place, ends[(k + 1) % 3].place];
      return vertex === undefined ? null : { vertex, place: [(here[0] + there[0]) / 2, (here[1] + there[1]) / 2] };
    });
    const number = cuts.filter((cut) => cut !== null).length;
    // Turned so that with one cut it is on the first side, with two it is not on the last one.
    const turn = number === 1 ? cuts.findIndex((cut) => cut !== null) : number === 2 ? (cuts.findIndex((cut) => cut === null) + 1) % 3 : 0;
    const [a, b, c] = [0, 1, 2].map((k) => ends[(k + turn) % 3]);
    const [ab, bc, ca] = /** @type {typeof ends} */ ([0, 1, 2].map((k) => cuts[(k + turn) % 3]));
    if (number === 1) return [[a, ab, c], [ab, b, c]];
    if (number === 2) return [[a, ab, c], [ab, bc, c], [ab, b, bc]];
    return [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
  }

  /** How far linear interpolation of anything that grows no faster than its place moves may be off: (1). @param {number} t */
  reachOf(t) {
    const a = this.corners[3 * t], b = this.corners[3 * t + 1], c = this.corners[3 * t + 2];
    return Math.sqrt(Math.max(this.squareOf(a, b), this.squareOf(b, c), this.squareOf(c, a)) / 3);
  }

  /**
   * How far linear interpolation of the distance may be off over a triangle: see above.
   * @param {number} t
   * @param {FlatFaces | null} flat
   */
  errorOf(t, flat) {
    const { distance, foot } = this.feet;
    const { points, corners } = this;
    let low = 0, high = 0, least = Infinity, most = 0;
    for (let k = 0; k < 3; k++) {
      const i = corners[3 * t + k], j = corners[3 * t + (k === 2 ? 0 : k + 1)];
      const V = this.squareOf(i, j);
      const D = (distance[i] - distance[j]) ** 2;
      const F = (foot[3 * i] - foot[3 * j]) * (points[3 * i] - points[3 * j]) + (foot[3 * i + 1] - foot[3 * j + 1]) * (points[3 * i + 1] - points[3 * j + 1])
        + (foot[3 * i + 2] - foot[3 * j + 2]) * (points[3 * i + 2] - points[3 * j + 2]);
      low = Math.max(low, (V - D) / 3);
      high = Math.max(high, (2 * F - V + D) / 3);
      least = Math.min(least, distance[i]);
      most = Math.max(most, distance[i]);
    }
    const reach = this.reachOf(t);
    const below = Math.min(reach, most, least > 0 ? low / least : Infinity);
    const above = Math.min(reach, Math.sqrt(high), least > 0 ? high / (2 * least) : Infinity);
    return above <= below || (flat && this.isOverOne(t, flat)) ? below : above;
  }

  /** Do the feet of a triangle's corners lie on one flat, convex face? @param {number} t @param {FlatFaces} flat */
  isOverOne(t, flat) {
    const { foot, face } = this.feet;
    const corners = [...this.corners.subarray(3 * t, 3 * t + 3)];
    const feet = corners.map((vertex) => foot.subarray(3 * vertex, 3 * vertex + 3));
    return corners.some((vertex) => flat.holds(face[vertex], feet));
  }
}

/**
 * Twice the room.
 * @template {Record<string, Uint32Array | Float32Array | Float64Array>} T
 * @param {T} rows
 * @returns {T}
 */
function grown(rows) {
  return /** @type {T} */ (Object.fromEntries(Object.entries(rows).map(([name, row]) => {
    const more = new /** @type {any} */ (row).constructor(2 * row.length + 4);
    more.set(row);
    return [name, more];
  })));
}

/**
 * @template {Float64Array<ArrayBuffer> | Int32Array<ArrayBuffer>} T
 * @param {T} one
 * @param {T} other
 * @returns {T}
 */
function joined(one, other) {
  const all = /** @type {T} */ (new /** @type {any} */ (one).constructor(one.length + other.length));
  all.set(one);
  all.set(other, one.length);
  return all;
}
