// The page of jobs: what waits, runs and ended, newest first.

import { client } from "../core/connection.js";
import { deleteLater, isHeld } from "../core/deletion.js";
import { h, select } from "../core/dom.js";
import { duration, time } from "../core/format.js";
import { run } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { on, state } from "../core/state.js";
import { showDetails } from "./details.js";
import { History, isOpen } from "./history.js";
import { KINDS, answerOf, meshesOf, questionOf, viewOf } from "./words.js";

/** @import { Job } from "../../js/types.js" */

/** The columns, and whether they hold numbers. */
const HEADS = /** @type {[string, boolean][]} */ ([
  ["Asked", false], ["Question", false], ["Meshes", false], ["State", false], ["Answer", true], ["Time", true]]);
const STATES = ["queued", "running", "succeeded", "failed", "canceled"];

/** @param {HTMLElement} panel */
export function showJobs(panel) {
  const page = new JobsPage(panel);
  return () => page.leave();
}

class JobsPage {
  /** @param {HTMLElement} panel */
  constructor(panel) {
    this.title = h("h2", { id: "jobs-title" }, "Jobs");
    this.body = h("tbody", { role: "rowgroup" });
    this.empty = h("p", { className: "empty" });
    this.table = h("table", { className: "cards", role: "table", "aria-labelledby": "jobs-title" },
      h("thead", { role: "rowgroup" }, h("tr", { role: "row" }, ...HEADS.map(([words, isNumber]) => h("th", { scope: "col", role: "columnheader", className: isNumber ? "number" : "" }, words)), h("td", { role: "cell" }))), this.body);
    this.older = h("button", { type: "button", hidden: true, onclick: () => run(() => this.history.more()) }, "Older jobs");
    this.kind = select("type", [["", "all kinds"], ...Object.entries(KINDS)], parameter("type") ?? "");
    this.state = select("state", [["", "all states"], ...STATES.map((name) => /** @type {[string, string]} */ ([name, name]))], parameter("state") ?? "");
    this.mesh = h("select", { name: "mesh" });
    this.label = h("input", { type: "search", name: "label", placeholder: "any", autocomplete: "off", value: parameter("label") ?? "" });
    for (const choice of [this.kind, this.state, this.mesh, this.label]) choice.addEventListener("change", () => this.filter());
    panel.append(h("section", { className: "section", "aria-labelledby": "jobs-title" },
      h("header", {}, this.title, h("label", { className: "inline" }, "Kind", this.kind), h("label", { className: "inline" }, "State", this.state),
        h("label", { className: "inline" }, "Of", this.mesh), h("label", { className: "inline" }, "Label", this.label)),
      h("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Jobs, the newest first" }, this.table), this.empty, h("div", { className: "row" }, this.older)));
    /** The rows as they are, with what they show. @type {Map<string, { key: string, row: HTMLElement }>} */
    this.rows = new Map();
    this.drawMeshes(parameter("mesh") ?? "");
    this.history = new History(this.wanted, () => this.draw());
    this.off = on("meshes", () => {
      this.drawMeshes(this.mesh.value);
      this.draw();
    });
    this.draw();
  }

  /** What the daemon is to list. */
  get wanted() {
    return { state: this.state.value, type: this.kind.value, mesh: this.mesh.value, label: this.label.value.trim() };
  }

  /** The meshes to choose from. @param {string} chosen also when it is gone */
  drawMeshes(chosen) {
    const options = /** @type {[string, string][]} */ ([["", "all meshes"], ...state.meshes.map(({ id, name }) => [id, name || id])]);
    if (chosen !== "" && !options.some(([id]) => id === chosen)) options.push([chosen, chosen]);
    this.mesh.replaceChildren(...options.map(([value, words]) => h("option", { value, selected: value === chosen }, words)));
  }

  filter() {
    this.history.filter = this.wanted;
    setParameters(this.history.filter);
    run(() => this.history.start());
  }

  draw() {
    const { history, body, title, table, empty } = this;
    if (!history) return; // its first answer draws
    const jobs = history.jobs.filter(({ id }) => !isHeld(id));
    const before = this.rows;
    this.rows = new Map(jobs.map((job) => [job.id, this.rowOf(job, before.get(job.id))]));
    const wanted = [...this.rows.values()].map(({ row }) => row);
    const isSame = wanted.length === body.children.length && wanted.every((row, place) => body.children[place] === row);
    if (!isSame) body.replaceChildren(...wanted);
    const open = jobs.filter(isOpen).length;
    title.textContent = open > 0 ? `Jobs, ${open} open` : "Jobs";
    table.hidden = jobs.length === 0;
    this.older.hidden = !history.hasMore;
    empty.hidden = jobs.length > 0;
    const isFiltered = Object.values(this.wanted).some((value) => value !== "");
    empty.textContent = !history.isRead ? "Asking the daemon." : isFiltered ? "There are no such jobs." : "No jobs yet. Choose two meshes and compare them.";
  }

  /** The row of a job: the one that is there, unless something of it has changed. @param {Job} job @param {{ key: string, row: HTMLElement } | undefined} before */
  rowOf(job, before) {
    const labels = job.labels ?? [];
    const cells = [time(job.created), `${questionOf(job)}${labels.length > 0 ? ` · ${labels.join(", ")}` : ""}`, meshesOf(job), job.state, answerOf(job), elapsed(job)];
    const key = cells.join("\n");
    if (before?.key === key) return before;
    const focused = before?.row.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
    const shown = cells.map((cell, place) => (place === 3 ? h("span", { className: `state ${job.state}` }, cell) : cell));
    const row = h("tr", { role: "row" },
      ...shown.map((cell, place) => h("td", { role: "cell", "data-head": HEADS[place][0], className: HEADS[place][1] ? "number" : "" }, cell)),
      h("td", { role: "cell", className: "buttons" }, this.buttons(job)));
    if (before?.row.isConnected) before.row.replaceWith(row);
    if (focused) /** @type {HTMLElement | null} */ (row.querySelector(`[data-key="${focused}"]`))?.focus();
    return { key, row };
  }

  /** @param {Job} job */
  buttons(job) {
    const about = `of the job of ${time(job.created)}`;
    const button = (/** @type {string} */ words, /** @type {string} */ label, /** @type {() => Promise<unknown>} */ action) => h("button", {
      type: "button", "aria-label": `${label} ${about}`, "data-key": words, onclick: () => run(action) }, words);
    const view = viewOf(job);
    return h("span", { className: "row" },
      isOpen(job) && button("Cancel", "Cancel", async () => {
        await client.jobs.cancel(job.id);
        await this.history.refresh();
      }),
      view !== null && h("a", { className: "button", href: view, "aria-label": `Show the result ${about}`, "data-key": "Show" }, "Show"),
      button("Details", "Details", () => showDetails(job.id, () => run(() => this.history.start()))),
      !isOpen(job) && button("Delete", "Delete the record", async () => deleteLater({
        id: job.id, words: "The job is deleted, and its answer with it.", commit: () => client.jobs.delete(job.id), onChange: () => this.draw() })));
  }

  leave() {
    this.off();
    this.history.leave();
  }
}

/** @param {Job} job */
function elapsed({ started, ended, state: job }) {
  if (!started) return "";
  const end = ended ? Date.parse(ended) : job === "running" ? Date.now() : NaN;
  return Number.isNaN(end) ? "" : duration(Math.max(0, end - Date.parse(started)));
}
