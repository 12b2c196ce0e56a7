// Uploads that report their progress. fetch cannot do that, so a browser's own older request does.

import { ConnectionError, makeProblem } from "./problem.js";

/** @import { Transport } from "./transport.js" */
/** @typedef {(sent: number, total: number) => void} OnProgress bytes sent so far; all of them: the daemon reads */

/**
 * @param {Transport} transport
 * @param {string} path
 * @param {{ query: Record<string, string | undefined>, headers: Record<string, string | undefined>, body: Blob,
 *   onProgress: OnProgress, signal?: AbortSignal }} call
 * @returns {Promise<{ status: number, text: string }>} of a success
 */
export function uploadWithProgress(transport, path, { query, headers, body, onProgress, signal }) {
  return new Promise((resolve, reject) => {
    signal?.throwIfAborted();
    const request = new XMLHttpRequest();
    request.open("POST", transport.url(path, query));
    for (const [name, value] of Object.entries(transport.headers(headers))) request.setRequestHeader(name, value);
    request.upload.onprogress = (event) => onProgress(event.loaded, event.total);
    request.onload = () => {
      const { status, responseText: text } = request;
      if (status >= 200 && status < 300) resolve({ status, text });
      else reject(makeProblem(status, text, request.getResponseHeader("Retry-After")));
    };
    request.onerror = () => reject(new ConnectionError("the daemon does not answer, or broke off the upload"));
    request.onabort = () => reject(signal?.reason);
    signal?.addEventListener("abort", () => request.abort(), { once: true });
    request.send(body);
  });
}
