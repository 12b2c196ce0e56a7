// Shapes by formula, as { vertices, faces }, and writers of files.

export const SPHERE_TURN = Math.PI / 100;
export const SPHERE_DISTANCE = 1 - Math.cos(SPHERE_TURN);

/** A UV sphere of quads without its poles, turned about its axis. Turned by half a meridian, its points farthest from the
 * unturned one lie on the equator, at 1 - cos(pi / meridians). */
export function sphere(turn = 0, parallels = 50, meridians = 100) {
  const vertices = [];
  const faces = [];
  for (let i = 1; i < parallels; i++) {
    const polar = (Math.PI * i) / parallels;
    for (let j = 0; j < meridians; j++) {
      const azimuth = (2 * Math.PI * j) / meridians + turn;
      vertices.push([Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)]);
    }
  }
  for (let i = 0; i < parallels - 2; i++) {
    for (let j = 0; j < meridians; j++) {
      const k = (j + 1) % meridians;
      faces.push([i * meridians + j, (i + 1) * meridians + j, (i + 1) * meridians + k, i * meridians + k]);
    }
  }
  return { vertices, faces };
}

/** The sides of a box, each a patch of its own: eight irregular vertices. */
export function box(steps = 8, size = 1) {
  const vertices = [];
  const faces = [];
  const places = new Map();
  const at = (point) => {
    const key = point.join();
    if (!places.has(key)) {
      places.set(key, vertices.length);
      vertices.push(point.map((value) => (value / steps) * size));
    }
    return places.get(key);
  };
  for (const [u, v, w] of [[0, 1, 2], [1, 2, 0], [2, 0, 1]]) {
    for (const side of [0, steps]) {
      for (let i = 0; i < steps; i++) {
        for (let j = 0; j < steps; j++) {
          const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(([di, dj]) => {
            const point = [0, 0, 0];
            point[u] = i + di;
            point[v] = j + dj;
            point[w] = side;
            return at(point);
          });
          faces.push(side ? corners : corners.reverse());
        }
      }
    }
  }
  return { vertices, faces };
}

/** A block with a square hole from above, down to a height: its outside, its rim, the walls and the bottom of the hole. */
export function well(bottom) {
  const ring = (low, high, z) => [[low, low, z], [high, low, z], [high, high, z], [low, high, z]];
  const vertices = [...ring(0, 1, 0), ...ring(0, 1, 1), ...ring(0.3, 0.7, 1), ...ring(0.3, 0.7, bottom)];
  const walls = [0, 4, 8].flatMap((first) => [0, 1, 2, 3].map((k) => [first + k, first + ((k + 1) % 4), first + 4 + ((k + 1) % 4), first + 4 + k]));
  return { vertices, faces: [[3, 2, 1, 0], ...walls, [12, 13, 14, 15]] };
}

/** The twelve edges of a box as a layout: every side is a patch. */
export function boxLayout(steps = 8) {
  const nodes = [0, 1, 2, 3, 4, 5, 6, 7].map((n) => [n & 1, (n >> 1) & 1, (n >> 2) & 1]);
  const curves = [];
  for (let from = 0; from < 8; from++) {
    for (const bit of [1, 2, 4]) {
      if (from & bit) continue;
      const points = Array.from({ length: steps + 1 }, (_, i) => nodes[from].map((x, k) => (1 << k === bit ? i / steps : x)));
      curves.push({ id: curves.length, from, to: from | bit, points });
    }
  }
  return { nodes, curves };
}

/** A point of a box from 0 to 1 on the ball round it, of radius 1 about 0. */
const onBall = (point) => {
  const from = point.map((x) => x - 0.5);
  return from.map((x) => x / Math.hypot(...from));
};
/** A box blown up to a ball: still eight irregular vertices. */
export const ball = (steps = 8) => ({ ...box(steps), vertices: box(steps).vertices.map(onBall) });
export function ballLayout(steps = 8) {
  const { nodes, curves } = boxLayout(steps);
  return { nodes: nodes.map(onBall), curves: curves.map((curve) => ({ ...curve, points: curve.points.map(onBall) })) };
}

/** A point of a box from 0 to 1 on the box from -1 to 1 with edges and corners rounded off, with a radius of 0.4. */
const onRoundedBox = (point) => {
  const from = point.map((x) => 2 * x - 1);
  const core = from.map((x) => Math.max(-0.6, Math.min(0.6, x)));
  const away = from.map((x, k) => x - core[k]);
  return core.map((x, k) => x + (0.4 * away[k]) / Math.hypot(...away));
};
export const roundedBox = (steps = 24) => ({ ...box(steps), vertices: box(steps).vertices.map(onRoundedBox) });
/** Its twelve edges, along the middle of the rounding. */
export function roundedBoxLayout(steps = 8) {
  const { nodes, curves } = boxLayout(steps);
  return { nodes: nodes.map(onRoundedBox), curves: curves.map((curve) => ({ ...curve, points: curve.points.map(onRoundedBox) })) };
}

/** A ball with hills and hollows, of six patches, and the twelve curves between these. */
const onHills = (point) => {
  const [x, y, z] = onBall(point);
  const radius = 1 + 0.16 * Math.sin(3 * x + 1) * Math.cos(2.5 * y) + 0.12 * Math.sin(4 * z + 2 * y);
  return [1.3 * radius * x, radius * y, 0.9 * radius * z];
};
export const hills = (steps = 24) => ({ ...box(steps), vertices: box(steps).vertices.map(onHills) });
export function hillsLayout(steps = 24) {
  const { nodes, curves } = boxLayout(steps);
  return { nodes: nodes.map(onHills), curves: curves.map((curve) => ({ ...curve, points: curve.points.map(onHills) })) };
}

/** Numbers from 0 to 1 by a 32-bit shift register (Marsaglia 2003), the same for the same seed. */
export function chance(seed) {
  let state = (seed * 2654435761) >>> 0 || 1;
  return () => {
    state ^= state << 13;
    state >>>= 0;
    state ^= state >>> 17;
    state ^= state << 5;
    state >>>= 0;
    return state / 2 ** 32;
  };
}

/** A flat square, and apart from it a heap of quads with corners pushed out of their planes. */
function heap(count, seed) {
  const random = chance(seed);
  const spread = (size) => (random() + random() + random() + random() - 2) * 1.7 * size;
  const vertices = [[9, 9, 9], [10, 9, 9], [10, 10, 9], [9, 10, 9]];
  const faces = [[0, 1, 2, 3]];
  for (let n = 0; n < count; n++) {
    const corner = [0, 1, 2].map(() => 3 * random());
    const [right, up, push] = [0, 1, 2].map(() => [0, 1, 2].map(() => spread(0.3)));
    const first = vertices.length;
    for (const [u, v, w] of [[0, 0, 0], [1, 0, 0], [1, 1, 2], [0, 1, 0]]) {
      vertices.push([0, 1, 2].map((k) => corner[k] + u * right[k] + v * up[k] + w * push[k]));
    }
    faces.push([first, first + 1, first + 2, first + 3]);
  }
  return { vertices, faces };
}

/** Every quad, as a bilinear patch, cut in count x count quads. */
function cut(mesh, count) {
  const vertices = [];
  const faces = [];
  for (const face of mesh.faces) {
    const corners = face.map((i) => mesh.vertices[i]);
    const first = vertices.length;
    for (let n = 0; n < (count + 1) ** 2; n++) {
      const [s, t] = [(n % (count + 1)) / count, Math.floor(n / (count + 1)) / count];
      const weights = [(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t];
      vertices.push([0, 1, 2].map((k) => corners.reduce((sum, corner, i) => sum + weights[i] * corner[k], 0)));
    }
    for (let n = 0; n < count ** 2; n++) {
      const at = first + (n % count) + Math.floor(n / count) * (count + 1);
      faces.push([at, at + 1, at + count + 2, at + count + 1]);
    }
  }
  return { vertices, faces };
}

/** Two heaps, the second raised by HEAP_DISTANCE and cut by another grid. As bilinear patches and to 1e-12 the search
 * takes many minutes. */
export const HEAP_DISTANCE = 1 / 512;
export function heaps() {
  const whole = heap(1500, 1);
  const { vertices, faces } = cut(whole, 3);
  return [cut(whole, 2), { vertices: vertices.map(([x, y, z]) => [x, y, z + HEAP_DISTANCE]), faces }];
}
export const SLOW = { quads: "bilinear", gap: 1e-12 };

/** A wavy sheet of 2 * columns * rows triangles. */
export function sheet(columns, rows) {
  const vertices = [];
  const faces = [];
  for (let i = 0; i <= rows; i++) {
    for (let j = 0; j <= columns; j++) {
      vertices.push([j / columns, i / rows, 0.05 * Math.sin((12 * j) / columns) * Math.cos((9 * i) / rows)]);
    }
  }
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const k = i * (columns + 1) + j;
      faces.push([k, k + 1, k + columns + 2], [k, k + columns + 2, k + columns + 1]);
    }
  }
  return { vertices, faces };
}

/** Points on a torus. */
export function torusPoints(count, seed = 1) {
  const random = chance(seed);
  const vertices = [];
  for (let n = 0; n < count; n++) {
    const u = 2 * Math.PI * random();
    const v = 2 * Math.PI * random();
    const radius = 1 + 0.4 * Math.cos(v);
    vertices.push([radius * Math.cos(u), radius * Math.sin(u), 0.4 * Math.sin(v)]);
  }
  return { vertices, faces: [] };
}

export const moved = ({ vertices, faces }, by) => ({ vertices: vertices.map((point) => point.map((x, k) => x + by[k])), faces });

/** A shape as the page's worker has it. */
export function shapeOf({ vertices, faces }) {
  const starts = new Uint32Array(faces.length + 1);
  faces.forEach((corners, face) => { starts[face + 1] = starts[face] + corners.length; });
  return { points: new Float64Array(vertices.flat()), corners: new Uint32Array(faces.flat()), starts };
}

export function off({ vertices, faces }) {
  return ["OFF", `${vertices.length} ${faces.length} 0`, ...vertices.map((point) => point.join(" ")),
    ...faces.map((corners) => `${corners.length} ${corners.join(" ")}`), ""].join("\n");
}

/** Binary PLY with float positions. */
export function ply({ vertices, faces }) {
  const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${vertices.length}\n`
    + "property float x\nproperty float y\nproperty float z\n"
    + (faces.length > 0 ? `element face ${faces.length}\nproperty list uchar int vertex_indices\n` : "") + "end_header\n";
  const size = header.length + 12 * vertices.length + faces.reduce((sum, corners) => sum + 1 + 4 * corners.length, 0);
  const bytes = Buffer.alloc(size);
  let at = bytes.write(header, "latin1");
  for (const point of vertices) for (const value of point) at = bytes.writeFloatLE(value, at);
  for (const corners of faces) {
    at = bytes.writeUInt8(corners.length, at);
    for (const corner of corners) at = bytes.writeInt32LE(corner, at);
  }
  return bytes;
}
