// Quads of a surface at once, without a layout: how many, or how near, and a job that can be watched and stopped.

import { ProblemError } from "../js/index.js";
import { client, noteLoss } from "../core/connection.js";
import { h } from "../core/dom.js";
import { count, duration, percent } from "../core/format.js";
import { run } from "../core/messages.js";
import { setParameters } from "../core/route.js";
import { Search } from "../core/search.js";

/** @import { RemeshRequest, RemeshResult, StageEvent, SurfaceOfPoints } from "../../js/types.js" */
/** @import { Found } from "../core/search.js" */

const STAGES = { surface: "Making a surface of the points", quads: "Making quads", layout: "Making a layout", fill: "Filling the layout", measure: "Measuring the distance" };

/** Follows such a job by its stages. */
class Work extends Search {
  /** @type {StageEvent | null} */
  stage = null;

  /** @param {string} id @param {AbortSignal} signal @returns {Promise<Found>} */
  async follow(id, signal) {
    this.stage = null;
    setParameters({ job: id }); // whoever opens the page again, or its address, watches it as well
    for await (const event of client.jobs.events(id, { signal, onBreak: noteLoss })) {
      if (event.event === "stage") this.stage = event;
      if (event.event === "error") throw new ProblemError(event.problem);
      if (event.event === "result") return { id, result: event.result, isStopped: false };
    }
    throw new Error("the job ended without a result");
  }

  draw() {
    const { stage, hausdorff, quads } = this.stage ?? {};
    const far = hausdorff ? `; ${percent(hausdorff.upper_relative)} of the diagonal at most so far` : "";
    const words = this.stopper.disabled ? "Stopping" : stage ? `${STAGES[stage]}${quads ? `, ${count(quads)} quads` : ""}` : "Waiting";
    this.words.textContent = `${words}, ${duration(performance.now() - this.start)}${far}`;
  }
}

/** As it was left. */
const left = { quads: "5000", distance: "", blocks: false };

/**
 * @param {{ surface: () => string | null, onMade: (surface: string, result: RemeshResult) => Promise<unknown> }} options onMade: called
 *   with what came of it
 */
export function makeOnce({ surface, onMade }) {
  const work = new Work();
  const quads = h("input", { name: "once-quads", inputMode: "numeric", value: left.quads, placeholder: "as many as it takes", pattern: "\\s*[0-9]*\\s*", title: "a whole number" });
  const distance = h("input", { name: "once-distance", inputMode: "decimal", value: left.distance, placeholder: "any", pattern: "\\s*[0-9]*\\.?[0-9]*\\s*", title: "a number" });
  const blocks = h("input", { type: "checkbox", name: "once-blocks", checked: left.blocks });
  const start = h("button", { type: "submit", className: "primary" }, "Remesh");
  const outcome = h("p", { className: "outcome muted", id: "once", role: "status" });
  const form = h("form", { className: "form", "aria-label": "Quads at once" },
    h("label", {}, "About so many quads", quads), h("label", {}, "No farther than, % of diagonal", distance),
    h("label", { className: "check whole" }, blocks, "In patches, by an automatic layout"), h("div", { className: "row whole" }, start));
  form.addEventListener("input", () => Object.assign(left, { quads: quads.value, distance: distance.value, blocks: blocks.checked }));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    run(() => follow(() => work.run(request())));
  });

  /** @returns {RemeshRequest} */
  function request() {
    return { type: "remesh", mesh: surface() ?? "", semi_regular: blocks.checked,
      ...(Number(quads.value) > 0 ? { quads: Number(quads.value) } : {}),
      ...(Number(distance.value) > 0 ? { distance: Number(distance.value) / 100 } : {}) };
  }

  /** @param {() => Promise<Found>} ask */
  async function follow(ask) {
    start.disabled = true;
    outcome.textContent = "";
    try {
      const found = await ask();
      const result = /** @type {RemeshResult} */ (found.result);
      const { request: asked } = await client.jobs.get(found.id);
      await onMade(typeof asked.mesh === "string" ? asked.mesh : asked.mesh.mesh, result);
      outcome.textContent = wordsOf(result);
    } catch (error) {
      const isStopped = work.stopper.disabled && error instanceof ProblemError;
      if (isStopped) outcome.textContent = "Stopped; there is no mesh of it.";
      else throw error;
    } finally {
      draw();
    }
  }

  function draw() {
    start.disabled = work.isRunning || surface() === null;
  }

  return {
    section: h("section", { className: "section", "aria-labelledby": "once-title" },
      h("header", {}, h("h2", { id: "once-title" }, "Quads at once")), form, outcome, work.element),
    draw,
    /** Shows a job that was asked for before. @param {string} id */
    open: (id) => follow(() => work.open(id)),
    forget() { outcome.textContent = ""; },
    leave() { work.leave(); },
  };
}

/** @param {RemeshResult} result */
function wordsOf({ quads, patches, hausdorff, reached, points }) {
  const what = `${count(quads)} quads${patches ? ` in ${count(patches)} patches` : ""}`;
  if (points) return `${what}, ${wordsOfPoints(points)}; ${percent(points.hausdorff.upper_relative)} of the diagonal from the surface of the points, ${percent(hausdorff.upper_relative)} from the points themselves, at most${reached === false ? ": the distance was not reached" : ""}.`;
  return `${what}, proven to be no farther from the surface than ${percent(hausdorff.upper_relative)} of its diagonal${reached === false ? ": the distance was not reached" : ""}.`;
}

/** What was found of points. @param {SurfaceOfPoints} points */
function wordsOfPoints({ used, outliers, noise_relative: noise, normals, holes_filled: holes, thin_share: thin, borders }) {
  return [`of ${count(used)} points`, outliers > 0 ? `${count(outliers)} outliers left out` : "", noise > 0 ? `noise of ${percent(noise)}` : "",
    normals === "estimated" ? "normals estimated" : "", holes > 0 ? `${count(holes)} holes filled` : "", borders > 0 ? `${count(borders)} borders` : "", thin > 0.001 ? `${percent(thin)} of them on parts too thin for their density, which may be lost` : ""]
    .filter((words) => words !== "").join(", ");
}
