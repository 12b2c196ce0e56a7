// The page of jobs: what waits, runs and ended, newest first.

import { client } from "../core/connection.js";
import { isOpen, refreshJobs } from "../core/data.js";
import { h } from "../core/dom.js";
import { count, duration, length, time } from "../core/format.js";
import { run } from "../core/messages.js";
import { nameOf, on, state } from "../core/state.js";

/** @import { DeviationResult, HausdorffResult, Job } from "../../js/types.js" */

/** The columns, and whether they hold numbers. */
const HEADS = /** @type {[string, boolean][]} */ ([
  ["Asked", false], ["Question", false], ["Meshes", false], ["State", false], ["Answer", true], ["Time", true]]);

/** @param {HTMLElement} panel */
export function showJobs(panel) {
  const title = h("h2", { id: "jobs-title" }, "Jobs");
  const body = h("tbody");
  const empty = h("p", { className: "empty" });
  const table = h("table", { "aria-labelledby": "jobs-title" },
    h("thead", {}, h("tr", {}, ...HEADS.map(([words, isNumber]) => h("th", { scope: "col", className: isNumber ? "number" : "" }, words)), h("td"))), body);
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
    empty.textContent = state.hasJobs ? "Nothing was asked yet. Choose two meshes and compare them." : "Asking the daemon.";
  };
  draw();
  refreshJobs();
  return on(["jobs", "meshes"], draw);
}

/** @param {Job} job */
function row(job) {
  const { a, b, mesh } = job.request;
  const meshes = mesh ? nameOf(mesh) : `${nameOf(a)} → ${nameOf(b)}`;
  return h("tr", {},
    h("td", {}, time(job.created)), h("td", {}, question(job)), h("td", {}, meshes),
    h("td", {}, h("span", { className: `state ${job.state}` }, job.state)),
    h("td", { className: "number" }, answer(job)), h("td", { className: "number" }, elapsed(job)),
    h("td", { className: "buttons" }, buttons(job)));
}

/** @param {Job} job */
function question({ type, request }) {
  const reading = request.quads === "bilinear" ? ", bilinear" : "";
  const direction = request.direction === "a_to_b" ? ", A to B" : request.direction === "b_to_a" ? ", B to A" : "";
  const words = /** @type {Record<string, string>} */ ({
    hausdorff: "Hausdorff distance", deviation: "Deviation", project: `Nearest points, ${count(request.point_count)}` });
  return `${words[type] ?? type}${direction}${reading}`;
}

/** @param {Job} job */
function answer(job) {
  if (job.problem) return job.problem.detail;
  if (job.type === "deviation" && job.result) {
    const { mean } = /** @type {DeviationResult} */ (job.result);
    return `mean ${length(mean.lower, 5)} to ${length(mean.upper, 5)}`;
  }
  if (job.type === "project") return "";
  const bounds = /** @type {HausdorffResult | undefined} */ (job.result) ?? job.progress;
  return bounds && "lower" in bounds ? `${length(bounds.lower, 7)} to ${length(bounds.upper, 7)}` : "";
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
  const { a, b } = job.request;
  const link = job.type === "hausdorff"
    && h("a", { className: "button", href: `#compare?a=${a}&b=${b}&job=${job.id}`, "aria-label": `Show the bounds ${about}` }, "Show");
  return h("span", { className: "row" }, isOpen(job) && cancel, link);
}
