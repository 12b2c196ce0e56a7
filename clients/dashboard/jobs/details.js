// All that is known of a job, in a dialog.

import { client } from "../core/connection.js";
import { figures, h } from "../core/dom.js";
import { time } from "../core/format.js";
import { makeLabels } from "../core/labels.js";
import { questionOf } from "./words.js";

/** @param {string} id @param {() => void} onChange its labels are others */
export async function showDetails(id, onChange) {
  const job = await client.jobs.get(id);
  const when = [["Asked", job.created], ["Started", job.started], ["Ended", job.ended]].flatMap(([name, iso]) =>
    (iso ? [/** @type {[string, string]} */ ([name, time(iso)])] : []));
  const text = (/** @type {string} */ title, /** @type {unknown} */ value) => value !== undefined
    && h("section", { "aria-label": title }, h("h3", {}, title), h("pre", { tabIndex: 0 }, JSON.stringify(value, null, 2)));
  const dialog = h("dialog", { className: "details", "aria-labelledby": "details-title" },
    h("form", { method: "dialog" }, h("h2", { id: "details-title" }, questionOf(job)),
      figures([["Job", job.id], ["State", job.state], ...when], "figures single"),
      h("div", { className: "form" }, h("div", { className: "whole" }, makeLabels(job.labels ?? [], async (labels) => {
        await client.jobs.change(id, { labels });
        onChange();
      }))),
      text("Request", job.request), text("Progress", job.result ? undefined : job.progress), text("Result", job.result), text("Problem", job.problem),
      h("div", { className: "row" }, h("button", { type: "submit", className: "primary" }, "Close"))));
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}
