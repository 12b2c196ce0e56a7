// Which part of a surface lies in which patch of a layout: the surface fills cells of a grid, curves are walls of cells, and
// what they part is flooded. The cells are coloured, for the graphics card to look up.

import { findSpacing } from "./cloud.js";
import { coonsPoints } from "./coons.js";

/** @import { Shape } from "./ply.js" */
/** @import { Frame } from "./soup.js" */
/** @typedef {{ curves: { id: number, points: number[][] }[], patches: { sides: number[], middle: number[], tint: number[] }[] }} Plan
 *   sides: ids of curves; middle: where the patch is looked for; tint: r, g, b from 0 to 255 */
/** @typedef {{ sides: number[], low: number[], size: number, surface: Uint8Array }} Cells of the scene's box: how many along
 *   each axis, where they begin, how large they are, and which of them the surface meets */

const CELL = 1 / 170;
const CELL_SPACINGS = 2;
/** Walls reach this many cells beyond a curve: with one, regions meet across an edge that is sharp. */
const WALL_REACH = 2;
/** A region of more than half the surface, and so many times as large as its Coons patch, has a gap in its border. */
const LEAK = 4;
/** How far from its Coons patch the surface of a patch without a region is coloured, in cells. */
const COONS_REACH = 3;
/** The share of a region's border that must be of its patch. */
const LEAST_BORDER = 0.75;

/**
 * @param {Shape} shape
 * @param {Frame} frame
 * @returns {Cells}
 */
export function fillCells({ points, corners, starts }, { centre, scale }) {
  const count = points.length / 3;
  const isCloud = starts.length <= 1;
  const place = new Float64Array(points.length);
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i++) {
    const k = i % 3;
    place[i] = (points[i] - centre[k]) * scale;
    low[k] = Math.min(low[k], place[i]);
    high[k] = Math.max(high[k], place[i]);
  }
  const size = isCloud ? Math.max(CELL, CELL_SPACINGS * findSpacing(Float32Array.from(place))) : CELL;
  const sides = low.map((value, k) => Math.floor((high[k] - value) / size) + 2 * WALL_REACH + 3);
  const cells = { sides, low: low.map((value) => value - (WALL_REACH + 1) * size), size, surface: new Uint8Array(sides[0] * sides[1] * sides[2]) };
  if (isCloud) {
    for (let p = 0; p < count; p++) cells.surface[cellOf(cells, place[3 * p], place[3 * p + 1], place[3 * p + 2])] = 1;
    return cells;
  }
  for (let face = 0; face + 1 < starts.length; face++) {
    for (let k = starts[face] + 1; k + 1 < starts[face + 1]; k++) fillTriangle(cells, place, corners[starts[face]], corners[k], corners[k + 1]);
  }
  return cells;
}

/** @param {Cells} cells @param {number} x @param {number} y @param {number} z */
function cellOf({ sides, low, size }, x, y, z) {
  const i = Math.floor((x - low[0]) / size), j = Math.floor((y - low[1]) / size), k = Math.floor((z - low[2]) / size);
  return (k * sides[1] + j) * sides[0] + i;
}

/** @param {Cells} cells @param {Float64Array} place @param {number} a @param {number} b @param {number} c */
function fillTriangle(cells, place, a, b, c) {
  const at = (/** @type {number} */ vertex, /** @type {number} */ k) => place[3 * vertex + k];
  const side = (/** @type {number} */ p, /** @type {number} */ q) => Math.hypot(at(p, 0) - at(q, 0), at(p, 1) - at(q, 1), at(p, 2) - at(q, 2));
  const steps = Math.max(1, Math.ceil(Math.max(side(a, b), side(b, c), side(c, a)) / (0.6 * cells.size)));
  for (let i = 0; i <= steps; i++) {
    for (let j = 0; i + j <= steps; j++) {
      const u = i / steps, v = j / steps, w = 1 - u - v;
      cells.surface[cellOf(cells, w * at(a, 0) + u * at(b, 0) + v * at(c, 0), w * at(a, 1) + u * at(b, 1) + v * at(c, 1),
        w * at(a, 2) + u * at(b, 2) + v * at(c, 2))] = 1;
    }
  }
}

/** How far the cells within a reach of one are in the array, itself among them. @param {Cells} cells @param {number} reach */
function neighbours({ sides }, reach = 1) {
  const near = Array.from({ length: 2 * reach + 1 }, (_, place) => place - reach);
  return near.flatMap((k) => near.flatMap((j) => near.map((i) => (k * sides[1] + j) * sides[0] + i)));
}

/**
 * The walls: in each cell one more than the place of the curve that goes through it or a neighbour.
 * @param {Cells} cells
 * @param {Frame} frame
 * @param {Plan["curves"]} curves
 */
function buildWalls(cells, { centre, scale }, curves) {
  const walls = new Int32Array(cells.surface.length);
  const around = neighbours(cells, WALL_REACH);
  const put = (/** @type {number[]} */ point, /** @type {number} */ curve) => {
    const inside = point.map((value, k) => Math.max(cells.low[k] + (WALL_REACH + 0.5) * cells.size,
      Math.min(value, cells.low[k] + (cells.sides[k] - WALL_REACH - 0.5) * cells.size)));
    const cell = cellOf(cells, inside[0], inside[1], inside[2]);
    for (const step of around) walls[cell + step] = curve + 1;
  };
  curves.forEach(({ points }, curve) => {
    const line = points.map((point) => point.map((value, k) => (value - centre[k]) * scale));
    for (let i = 0; i + 1 < line.length; i++) {
      const length = Math.hypot(...line[i].map((value, k) => value - line[i + 1][k]));
      const steps = Math.max(1, Math.ceil(length / (0.5 * cells.size)));
      for (let s = 0; s <= steps; s++) put(line[i].map((value, k) => value + (s / steps) * (line[i + 1][k] - value)), curve);
    }
  });
  return walls;
}

/**
 * Floods what lies between the walls.
 * @param {Cells} cells
 * @param {Int32Array} walls
 */
function flood(cells, walls) {
  const region = new Int32Array(walls.length);
  const around = neighbours(cells);
  const inside = ring(cells);
  /** How often the border of each region meets each curve. @type {Map<number, number>[]} */
  const borders = [];
  /** Cells of each region. @type {number[]} */
  const sizes = [];
  /** @type {number[]} */
  const stack = [];
  for (let start = 0; start < region.length; start++) {
    if (!cells.surface[start] || walls[start] || region[start]) continue;
    const border = new Map();
    borders.push(border);
    sizes.push(0);
    region[start] = borders.length;
    stack.push(start);
    while (stack.length > 0) {
      const cell = /** @type {number} */ (stack.pop());
      sizes[sizes.length - 1]++;
      for (const step of around) {
        const next = cell + step;
        if (!cells.surface[next] || region[next] || !inside(next)) continue;
        if (walls[next]) {
          border.set(walls[next] - 1, (border.get(walls[next] - 1) ?? 0) + 1);
          continue;
        }
        region[next] = borders.length;
        stack.push(next);
      }
    }
  }
  return { region, borders, sizes };
}

/** Whether a cell is none of the outermost, which have no neighbours all round. @param {Cells} cells */
function ring({ sides }) {
  const layer = sides[0] * sides[1];
  return (/** @type {number} */ cell) => cell >= layer && cell < layer * (sides[2] - 1);
}

/**
 * The region of each patch: of those that its curves bound, the one nearest to its middle.
 * @param {Cells} cells
 * @param {ReturnType<typeof flood>} flooded
 * @param {Frame} frame
 * @param {Plan} plan
 * @returns {{ tints: Map<number, number[]>, lost: Plan["patches"] }} tints by region; the patches without one
 */
function matchPatches(cells, { region, borders, sizes }, frame, { curves, patches }) {
  const { centre, scale } = frame;
  const total = sizes.reduce((sum, size) => sum + size, 0);
  const tints = new Map();
  /** @type {Plan["patches"]} */
  const lost = [];
  for (const patch of patches) {
    const { sides, middle, tint } = patch;
    const own = new Set(sides.map((id) => curves.findIndex((curve) => curve.id === id)));
    const fitting = new Set(borders.flatMap((border, place) => {
      let all = 0, mine = 0;
      for (const [curve, count] of border) {
        all += count;
        if (own.has(curve)) mine += count;
      }
      const isBounded = [...own].every((curve) => border.has(curve));
      return isBounded && mine >= LEAST_BORDER * all && !tints.has(place + 1) ? [place + 1] : [];
    }));
    const nearest = fitting.size < 2 ? [...fitting][0] : nearestRegion(cells, region, fitting, middle.map((value, k) => (value - centre[k]) * scale));
    const hasLeaked = nearest !== undefined && 2 * sizes[nearest - 1] > total
      && sizes[nearest - 1] > LEAK * coonsCells(cells, frame, curves, patch).size;
    if (nearest !== undefined && !hasLeaked) tints.set(nearest, tint);
    else lost.push(patch);
  }
  return { tints, lost };
}

/**
 * The cells of the Coons patch of four curves.
 * @param {Cells} cells
 * @param {Frame} frame
 * @param {Plan["curves"]} curves
 * @param {Plan["patches"][0]} patch
 */
function coonsCells(cells, { centre, scale }, curves, { sides }) {
  const lines = sides.map((id) => (curves.find((curve) => curve.id === id)?.points ?? []).map((point) => point.map((value, k) => (value - centre[k]) * scale)));
  /** @type {Set<number>} */
  const found = new Set();
  for (const point of coonsPoints(lines, cells.size)) {
    const isInside = point.every((value, k) => value >= cells.low[k] && value < cells.low[k] + cells.sides[k] * cells.size);
    if (isInside) found.add(cellOf(cells, point[0], point[1], point[2]));
  }
  return found;
}

/**
 * Colours what lies near the Coons patch of four curves and has no colour: curves that leap over a fold part no region off.
 * @param {Cells} cells
 * @param {Frame} frame
 * @param {Plan["curves"]} curves
 * @param {Plan["patches"][0]} patch
 * @param {Uint8Array} colours
 */
function colourByCoons(cells, frame, curves, patch, colours) {
  const { tint } = patch;
  const [around, beside] = [neighbours(cells, COONS_REACH), neighbours(cells)];
  const put = (/** @type {number} */ cell) => { if (!colours[4 * cell + 3]) colours.set([tint[0], tint[1], tint[2], 255], 4 * cell); };
  for (const cell of coonsCells(cells, frame, curves, patch)) {
    for (const step of around) {
      const next = cell + step;
      if (!cells.surface[next] || colours[4 * next + 3]) continue;
      for (const one of beside) if (one === 0 || !cells.surface[next + one]) put(next + one);
    }
  }
}

/** @param {Cells} cells @param {Int32Array} region @param {Set<number>} among @param {number[]} middle */
function nearestRegion({ sides, low, size }, region, among, middle) {
  let best = Infinity;
  let found;
  for (let cell = 0; cell < region.length; cell++) {
    if (!among.has(region[cell])) continue;
    const i = cell % sides[0], j = Math.floor(cell / sides[0]) % sides[1], k = Math.floor(cell / (sides[0] * sides[1]));
    const away = Math.hypot(...[i, j, k].map((n, axis) => low[axis] + (n + 0.5) * size - middle[axis]));
    if (away >= best) continue;
    best = away;
    found = region[cell];
  }
  return found;
}

/**
 * The colours of the cells, premultiplied: those of patches. All regions spread into the walls alike, and a cell beyond the
 * surface.
 * @param {Cells} cells
 * @param {Frame} frame
 * @param {Plan} plan
 */
export function colourCells(cells, frame, plan) {
  const walls = buildWalls(cells, frame, plan.curves);
  const flooded = flood(cells, walls);
  const { tints, lost } = matchPatches(cells, flooded, frame, plan);
  const around = neighbours(cells);
  const inside = ring(cells);
  let region = flooded.region;
  for (let pass = 0; pass <= WALL_REACH + 1; pass++) {
    const wider = region.slice();
    for (let cell = 0; cell < region.length; cell++) {
      if (!region[cell] || !inside(cell)) continue;
      for (const step of around) {
        const next = cell + step;
        if (region[next] === 0 && (pass > WALL_REACH || cells.surface[next])) wider[next] = region[cell];
      }
    }
    region = wider;
  }
  const colours = new Uint8Array(4 * region.length);
  for (let cell = 0; cell < region.length; cell++) {
    const tint = tints.get(region[cell]);
    if (tint) colours.set([tint[0], tint[1], tint[2], 255], 4 * cell);
  }
  for (const patch of lost) colourByCoons(cells, frame, plan.curves, patch, colours);
  return { colours, sides: cells.sides, low: cells.low, size: cells.size };
}
