// The page of jobs: what waits, runs and ended, newest first.

import { client } from "../core/connection.js";
import { isOpen, refreshJobs } from "../core/data.js";
import { h } from "../core/dom.js";
import { duration, time } from "../core/format.js";
import { run } from "../core/messages.js";
import { on, state } from "../core/state.js";
import { answerOf, meshesOf, questionOf, viewOf } from "./words.js";

/** @import { Job } from "../../js/types.js" */

/** The columns, and whether they hold numbers. */
const HEADS = /** @type {[string, boolean][]} */ ([
  ["Asked", false], ["Question", false], ["Meshes", false], ["State", false], ["Answer", true], ["Time", true]]);

/** @param {HTMLElement} panel */
export function showJobs(panel) {
  const title = h("h2", { id: "jobs-title" }, "Jobs");
  const body = h("tbody", { role: "rowgroup" });
  const empty = h("p", { className: "empty" });
  const table = h("table", { className: "cards", role: "table", "aria-labelledby": "jobs-title" },
    h("thead", { role: "rowgroup" }, h("tr", { role: "row" }, ...HEADS.map(([words, isNumber]) => h("th", { scope: "col", role: "columnheader", className: isNumber ? "number" : "" }, words)), h("td", { role: "cell" }))), body);
  panel.append(h("section", { className: "section", "aria-labelledby": "jobs-title" },
    h("header", {}, title), h("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "All jobs" }, table), empty));
  const draw = () => {
    const focused = body.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
    body.replaceChildren(...state.jobs.map(row));
    if (focused) /** @type {HTMLElement | null} */ (body.querySelector(`[data-key="${CSS.escape(focused)}"]`))?.focus();
    const open = state.jobs.filter(isOpen).length;
    title.textContent = open > 0 ? `Jobs, ${open} open` : "Jobs";
    table.hidden = state.jobs.length === 0;
    empty.hidden = state.jobs.length > 0;
    empty.textContent = state.hasJobs ? "No jobs yet. Choose two meshes and compare them." : "Asking the daemon.";
  };
  draw();
  refreshJobs();
  return on(["jobs", "meshes"], draw);
}

/** @param {Job} job */
function row(job) {
  const cells = [time(job.created), questionOf(job), meshesOf(job), h("span", { className: `state ${job.state}` }, job.state), answerOf(job), elapsed(job)];
  return h("tr", { role: "row" },
    ...cells.map((cell, place) => h("td", { role: "cell", "data-head": HEADS[place][0], className: HEADS[place][1] ? "number" : "" }, cell)),
    h("td", { role: "cell", className: "buttons" }, buttons(job)));
}

/** @param {Job} job */
function elapsed({ started, ended, state: job }) {
  if (!started) return "";
  const end = ended ? Date.parse(ended) : job === "running" ? Date.now() : NaN;
  return Number.isNaN(end) ? "" : duration(Math.max(0, end - Date.parse(started)));
}

/** @param {Job} job */
function buttons(job) {
  const about = `of the job of ${time(job.created)}`;
  const cancel = h("button", {
    type: "button", "aria-label": `Cancel ${about}`, "data-key": `cancel ${job.id}`,
    onclick: () => run(async () => {
      await client.jobs.cancel(job.id);
      await refreshJobs();
    }),
  }, "Cancel");
  const view = viewOf(job);
  const link = view !== null && h("a", { className: "button", href: view, "aria-label": `Show the result ${about}` }, "Show");
  return h("span", { className: "row" }, isOpen(job) && cancel, link);
}
