// Reads the binary PLY that the daemon writes: double x y z, and faces as lists of corners.

/**
 * @typedef {object} Shape a mesh or point set, as the file has it
 * @property {Float64Array} points rows of x, y, z
 * @property {Uint32Array} corners the corners of all faces, one after the other
 * @property {Uint32Array} starts where each face's corners begin; one more entry ends the last face
 */

const COUNT_SIZE = /** @type {Record<string, number>} */ ({ uchar: 1, ushort: 2, uint: 4 });

/**
 * @param {ArrayBuffer} file
 * @returns {Shape}
 */
export function readPly(file) {
  const head = new TextDecoder("latin1").decode(new Uint8Array(file, 0, Math.min(file.byteLength, 2048)));
  const end = head.indexOf("end_header\n");
  const pointCount = Number(/element vertex (\d+)/.exec(head)?.[1]);
  const faceCount = Number(/element face (\d+)/.exec(head)?.[1] ?? 0);
  if (end < 0 || !head.includes("binary_little_endian") || !head.includes("double x")) {
    throw new Error("the daemon sent a file that the page cannot read");
  }
  let at = end + "end_header\n".length;
  const points = new Float64Array(file.slice(at, at + pointCount * 24));
  at += pointCount * 24;
  const countSize = COUNT_SIZE[/property list (\w+)/.exec(head)?.[1] ?? "uchar"];
  return { points, ...readFaces(new DataView(file, at), faceCount, countSize) };
}

/**
 * @param {DataView} view
 * @param {number} faceCount
 * @param {number} countSize bytes of a face's number of corners
 */
function readFaces(view, faceCount, countSize) {
  const starts = new Uint32Array(faceCount + 1);
  const corners = new Uint32Array((view.byteLength - faceCount * countSize) / 4);
  let at = 0;
  let filled = 0;
  for (let face = 0; face < faceCount; face++) {
    const count = countSize === 1 ? view.getUint8(at) : countSize === 2 ? view.getUint16(at, true) : view.getUint32(at, true);
    at += countSize;
    for (let k = 0; k < count; k++, at += 4) corners[filled++] = view.getUint32(at, true);
    starts[face + 1] = filled;
  }
  return { corners, starts };
}
