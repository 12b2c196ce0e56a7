// Bodies that come a piece at a time, as async iterators.

import { ConnectionError } from "./problem.js";

/**
 * The blocks of bytes of a body as they come. A reader that stops early ends the connection.
 * @param {Response} response
 * @param {AbortSignal} [signal]
 * @returns {AsyncGenerator<Uint8Array, void>}
 */
export async function* readBlocks(response, signal) {
  if (!response.body) return;
  const reader = response.body.getReader();
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      yield value;
    }
  } catch (error) {
    signal?.throwIfAborted();
    throw new ConnectionError("the answer broke off", error);
  } finally {
    reader.cancel().catch(() => {}); // of a body that ended or failed there is nothing left to cancel
  }
}

/**
 * The objects of an NDJSON body. A last line without its end is left out: it was cut off.
 * @param {Response} response
 * @param {AbortSignal} [signal]
 * @returns {AsyncGenerator<any, void>}
 */
export async function* readLines(response, signal) {
  const decoder = new TextDecoder();
  let rest = "";
  for await (const block of readBlocks(response, signal)) {
    const lines = (rest + decoder.decode(block, { stream: true })).split("\n");
    rest = /** @type {string} */ (lines.pop());
    for (const line of lines) if (line !== "") yield JSON.parse(line);
  }
}

/**
 * Rows of `width` little-endian float64, in arrays of whole rows as they come.
 * @param {Response} response
 * @param {number} width
 * @param {AbortSignal} [signal]
 * @returns {AsyncGenerator<Float64Array, void>}
 */
export async function* readRows(response, width, signal) {
  const size = width * 8;
  let rest = new Uint8Array(0);
  for await (const block of readBlocks(response, signal)) {
    const bytes = new Uint8Array(rest.length + block.length);
    bytes.set(rest);
    bytes.set(block, rest.length);
    const end = bytes.length - (bytes.length % size);
    rest = bytes.slice(end);
    if (end > 0) yield new Float64Array(bytes.buffer, 0, end / 8);
  }
  if (rest.length > 0) throw new ConnectionError("the answer broke off within a row");
}

/**
 * Sleeps, unless the signal is given.
 * @param {number} ms
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
export function pause(ms, signal) {
  return new Promise((resolve, reject) => {
    signal?.throwIfAborted();
    const end = () => reject(/** @type {AbortSignal} */ (signal).reason);
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", end);
      resolve();
    }, ms);
    signal?.addEventListener("abort", () => { clearTimeout(timer); end(); }, { once: true });
  });
}
