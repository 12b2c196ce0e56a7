// Starts the page: its views, the address, the daemon.

import { showCollide } from "./collide/collide.js";
import { showCompare } from "./compare/compare.js";
import { client, connect } from "./core/connection.js";
import { startData } from "./core/data.js";
import { byId, h } from "./core/dom.js";
import { readAddress } from "./core/route.js";
import { on, state } from "./core/state.js";
import { startTheme } from "./core/theme.js";
import { askForToken } from "./core/token.js";
import { showDeform } from "./deform/deform.js";
import { showJobs } from "./jobs/jobs.js";
import { showMeshes } from "./meshes/meshes.js";
import { showRemesh } from "./remesh/remesh.js";
import { showSketch } from "./sketch/sketch.js";

/** @typedef {{ name: string, words: string, isWide?: boolean, show: (panel: HTMLElement) => () => void }} Page show fills
 *   the panel and returns what takes leave of it */

/** @type {Page[]} */
const pages = [
  { name: "meshes", words: "Meshes", show: showMeshes },
  { name: "compare", words: "Compare", show: showCompare },
  { name: "collide", words: "Collide", show: showCollide },
  { name: "deform", words: "Deform", show: showDeform },
  { name: "sketch", words: "Sketch", show: showSketch },
  { name: "remesh", words: "Remesh", show: showRemesh },
  { name: "jobs", words: "Jobs", isWide: true, show: showJobs },
];

let leave = () => {};

function showPage() {
  for (const link of byId("tabs").querySelectorAll("a")) {
    if (link.hash === `#${state.page}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  leave();
  const page = pages.find(({ name }) => name === state.page) ?? pages[0];
  document.title = `${page.words} – quadmeshd`;
  document.body.dataset.page = page.name;
  document.body.toggleAttribute("data-wide", Boolean(page.isWide));
  const panel = byId("panel");
  panel.scrollTop = 0;
  panel.replaceChildren();
  byId("stage-legend").replaceChildren();
  leave = page.show(panel);
}

byId("tabs").append(...pages.map(({ name, words }) => h("a", { href: `#${name}` }, words)));
byId("token").addEventListener("click", () => askForToken("A daemon with a token file wants one", (token) => {
  client.token = token;
  connect();
}));
on("page", showPage);
const names = pages.map(({ name }) => name);
addEventListener("hashchange", () => readAddress(names));
startTheme();
startData();
readAddress(names);
connect();
