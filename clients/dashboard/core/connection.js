// The one client of the page, and whether the daemon answers. After a loss it is asked again until it does.

import { Client, ConnectionError, ProblemError } from "../js/index.js";
import { byId } from "./dom.js";
import { changed, on, state } from "./state.js";

export const client = new Client();
const ASK_AGAIN_MS = 1000;
const ASK_MS = 15000;

/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;

let isLocked = false;

/** Asks the daemon what it is; what was missed meanwhile is read by who listens to "connection". */
export async function connect() {
  clearTimeout(timer);
  try {
    state.info = await client.system.info();
    isLocked = false;
    set("open");
    timer = setTimeout(connect, ASK_MS);
  } catch (error) {
    if (error instanceof ProblemError && error.status === 401) {
      state.info = null;
      isLocked = true;
      set("waiting");
      const { askForToken } = await import("./token.js");
      askForToken(error.detail, (token) => {
        client.token = token;
        connect();
      });
      return;
    }
    set("lost");
    timer = setTimeout(connect, ASK_AGAIN_MS);
  }
}

/** Notes that a request or stream found nobody. @param {unknown} error */
export function noteLoss(error) {
  if (!(error instanceof ConnectionError) || state.connection === "lost") return;
  set("lost");
  clearTimeout(timer);
  timer = setTimeout(connect, ASK_AGAIN_MS / 4);
}

/** @param {"waiting" | "open" | "lost"} connection */
function set(connection) {
  const before = state.connection;
  state.connection = connection;
  changed("info");
  if (connection !== before) changed("connection");
}

on("info", () => {
  const words = byId("connection");
  const { info, connection } = state;
  words.className = `connection ${connection}`;
  words.textContent = connection === "lost" ? "The daemon does not answer; trying again"
    : connection === "waiting" || !info ? (isLocked ? "The daemon wants a token" : "Asking the daemon")
    : `${info.version}, ${info.kernel}, ${info.workers} worker${info.workers === 1 ? "" : "s"}`;
});
