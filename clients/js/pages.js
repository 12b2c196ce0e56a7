// Lists that come in pages.

/** @import { Transport } from "./transport.js" */

/**
 * Every entry of a list, page by page as they are wanted.
 * @param {Transport} transport
 * @param {string} path
 * @param {string} member the array's name in the reply
 * @param {{ pageSize?: number, signal?: AbortSignal, [filter: string]: any }} options the others are parameters of the list
 * @returns {AsyncGenerator<any, void>}
 */
export async function* readPages(transport, path, member, { pageSize, signal, ...filters }) {
  /** @type {string | null} */
  let cursor = null;
  do {
    const page = await transport.json(path, { query: { ...filters, limit: pageSize, cursor }, signal });
    yield* page[member];
    cursor = page.next;
  } while (cursor !== null);
}
