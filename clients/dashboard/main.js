// Starts the page: its views, each fetched when it is first wanted, the address, the daemon.

import { client, connect } from "./core/connection.js";
import { startData } from "./core/data.js";
import { byId, h } from "./core/dom.js";
import { forgetMessages, run } from "./core/messages.js";
import { readAddress, setParameters } from "./core/route.js";
import { on, state } from "./core/state.js";
import { startTheme } from "./core/theme.js";
import { listenToDrops } from "./core/upload.js";

/** @typedef {(panel: HTMLElement) => () => void} Show fills the panel and returns what takes leave of it */
/** @typedef {{ name: string, words: string, isWide?: boolean, sides?: ("a" | "b")[], fetch: () => Promise<Show> }} Page */

/** @type {Page[]} */
const pages = [
  { name: "meshes", words: "Meshes", fetch: async () => (await import("./meshes/meshes.js")).showMeshes },
  { name: "compare", words: "Compare", sides: ["a", "b"], fetch: async () => (await import("./compare/compare.js")).showCompare },
  { name: "collide", words: "Collide", sides: ["a", "b"], fetch: async () => (await import("./collide/collide.js")).showCollide },
  { name: "deform", words: "Deform", sides: ["a"], fetch: async () => (await import("./deform/deform.js")).showDeform },
  { name: "sketch", words: "Sketch", sides: ["a"], fetch: async () => (await import("./sketch/sketch.js")).showSketch },
  { name: "remesh", words: "Remesh", fetch: async () => (await import("./remesh/remesh.js")).showRemesh },
  { name: "jobs", words: "Jobs", isWide: true, fetch: async () => (await import("./jobs/jobs.js")).showJobs },
];

let leave = () => {};
let turn = 0;
/** Is what the address wants on the page? */
let isShown = false;

async function showPage() {
  const mine = ++turn;
  const page = pages.find(({ name }) => name === state.page) ?? pages[0];
  for (const link of byId("tabs").querySelectorAll("a")) {
    if (link.hash === `#${page.name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${page.words} – quadmeshd`;
  if (document.body.dataset.page !== page.name) forgetMessages();
  leave();
  leave = () => {};
  isShown = false;
  const show = await page.fetch().catch(() => { if (mine === turn) throw new Error(`The view “${page.words}” could not be fetched; it will be when the daemon is back.`); });
  if (!show || mine !== turn) return;
  document.body.dataset.page = page.name;
  document.body.toggleAttribute("data-wide", Boolean(page.isWide));
  const panel = byId("panel");
  panel.scrollTop = 0;
  panel.replaceChildren();
  byId("stage-legend").replaceChildren();
  if (!["meshes", "jobs"].includes(page.name)) state.a ??= state.shown; // who goes on from a mesh means that one
  setParameters(Object.fromEntries((page.sides ?? []).map((side) => [side, state[side]])));
  leave = show(panel);
  isShown = true;
}

byId("tabs").append(...pages.map(({ name, words }) => h("a", { href: `#${name}` }, words)));
byId("token").addEventListener("click", () => run(async () => {
  const { askForToken } = await import("./core/token.js");
  askForToken("A daemon with a token file wants one", (token) => {
    client.token = token;
    connect();
  });
}));
on("page", () => run(showPage));
on("connection", () => { if (state.connection === "open" && !isShown) run(showPage); });
on(["meshes", "page"], () => { byId("stage-hint").hidden = state.meshes.length > 0 || !state.hasMeshes || state.page === "meshes"; });
const names = pages.map(({ name }) => name);
// Where somebody went, not what the address says by now: a view that arrives in between writes its choices there.
addEventListener("hashchange", ({ newURL }) => readAddress(names, new URL(newURL).hash));
startTheme();
listenToDrops();
startData();
readAddress(names, location.hash);
connect();
