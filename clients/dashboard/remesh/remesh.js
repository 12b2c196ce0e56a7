// The page that remeshes: a layout grows into a quad mesh, step by step, with its distance to the surface beside it.

import { meshChoice } from "../core/choice.js";
import { client } from "../core/connection.js";
import { refreshMeshes } from "../core/data.js";
import { isHeld } from "../core/deletion.js";
import { figures, h, select } from "../core/dom.js";
import { count, duration, percent, time } from "../core/format.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { changed, meshOf, on, state } from "../core/state.js";
import { downloads } from "../meshes/facts.js";
import { drawTools, toggle } from "../view/tools.js";
import { look, setLook } from "../view/view.js";
import { makeGoal } from "./goal.js";
import { makeOnce } from "./once.js";
import { Picture } from "./picture.js";
import { Runner } from "./runner.js";
import { distanceOf, drawBounds, drawSteps, stepTable } from "./steps.js";
import { textured } from "./texture.js";

/** @import { LayoutBrief, Mesh, Reconstruction, ReconstructionBrief, RemeshResult } from "../../js/types.js" */
/** @import { Goal } from "./runner.js" */

const MOST_STEPS = 64;

/** @param {HTMLElement} panel */
export function showRemesh(panel) {
  /** @type {Reconstruction | null} */
  let current = null;
  /** Quads that came at once are shown. */
  let isAtOnce = false;
  const picture = new Picture();
  const side = h("div", { className: "form" });
  const outcome = h("p", { className: "outcome muted", id: "remesh", role: "status" });
  const start = h("button", { type: "button", disabled: true, onclick: () => run(begin) }, "Start from the layout");
  const take = h("button", { type: "button", disabled: true, title: "Compute the patches again that the edits have touched", onclick: () => run(takeEdits) }, "Take over edits");
  const edit = h("a", { className: "button", href: "#sketch" }, "Edit the layout");
  const grown = h("div");
  const goal = makeGoal({ onStep: () => run(() => refine(1, {})), onRun: (wanted) => run(() => refine(MOST_STEPS, wanted)), onStop: () => run(() => runner.stop()) });
  const bounds = h("div");
  const chart = h("canvas", { className: "drawing low", role: "img", "aria-label": "Distance over the number of quads; its figures are in the table below" });
  const table = h("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "All steps" });
  const heat = h("button", { type: "button", disabled: true, "aria-pressed": "false", onclick: () => run(mapError) }, "Map the error");
  const files = h("div");
  const distance = h("section", { className: "section", "aria-labelledby": "error-title" },
    h("header", {}, h("h2", { id: "error-title" }, "Distance to the surface"), heat), bounds, chart, table);
  const download = h("section", { className: "section", "aria-labelledby": "download-title" }, h("h2", { id: "download-title" }, "Download"), files);
  const once = makeOnce({ surface: () => state.a, onMade: acceptAtOnce });
  panel.append(
    h("section", { className: "section", "aria-labelledby": "remesh-title" },
      h("header", {}, h("h2", { id: "remesh-title" }, "Remesh"), edit), side), once.section,
    h("section", { className: "section", "aria-labelledby": "steps-title" },
      h("header", {}, h("h2", { id: "steps-title" }, "By a layout, step by step")), h("div", { className: "row" }, start, take),
      goal.form, outcome),
    h("section", { className: "section", "aria-label": "Quads" }, picture.search.element, grown), distance, download);

  const runner = new Runner(async ({ reconstruction }) => {
    await accept(await client.reconstructions.get(reconstruction));
  });

  /** @param {number} most @param {Goal} wanted */
  async function refine(most, wanted) {
    setRunning(true);
    try {
      if (!current) await begin();
      if (!current) return;
      outcome.textContent = "Refining";
      outcome.textContent = endings(wanted)[await runner.run(current.id, most, wanted)];
    } finally {
      setRunning(false);
    }
  }

  let isRunning = false;
  /** @param {boolean} now */
  function setRunning(now) {
    isRunning = now;
    const layout = chosenLayout();
    goal.draw(isRunning, current !== null || layout !== "");
    start.disabled = isRunning || layout === "";
    take.disabled = isRunning || layout === "" || !current;
    edit.hidden = state.a === null;
    edit.textContent = layout === "" ? "Sketch a layout" : "Edit the layout";
    edit.href = `#sketch?a=${state.a}${layout === "" ? "" : `&layout=${layout}`}`;
    heat.disabled = isRunning || !(current || isAtOnce);
    once.draw();
  }

  /** Shows quads with their tools and their files. @param {Mesh} quads @param {Mesh | undefined} source */
  function drawMade(quads, source) {
    distance.hidden = download.hidden = false;
    heat.setAttribute("aria-pressed", "false");
    files.replaceChildren(downloads(quads), textured(quads));
    drawTools(source ? [quads, source] : [quads], { hasStructure: true, more: [
      toggle("Surface", "Show the surface through the quads", picture.hasSource, (isOn) => { run(() => picture.setSource(isOn)); })] });
  }

  /** @param {string} surface @param {RemeshResult} made */
  async function acceptAtOnce(surface, made) {
    current = null;
    isAtOnce = true;
    setParameters({ reconstruction: null });
    outcome.textContent = "";
    grown.replaceChildren(figures([
      ["Quads", count(made.quads)], ["Patches", made.patches ? count(made.patches) : "–"], ["Irregular vertices", count(made.irregular_vertices)],
      ["Folded quads", count(made.folded)], ["Least Jacobian", made.least_scaled_jacobian.toFixed(3)], ["Time", duration(made.elapsed_ms)]]));
    drawBounds(bounds, made, [`The surface lies ${percent(made.from_surface.upper_relative)} from the quads at most, and the quads ${percent(made.from_quads.upper_relative)} from it: both are proven`]);
    chart.hidden = table.hidden = true;
    await refreshMeshes();
    const quads = meshOf(made.mesh) ?? await client.meshes.get(made.mesh), source = meshOf(surface);
    drawMade(quads, source);
    drawChoices();
    await picture.showAtOnce(source, quads);
  }

  /** @param {Reconstruction} now */
  async function accept(now) {
    current = now;
    isAtOnce = false;
    once.forget();
    setParameters({ reconstruction: now.id, job: null });
    const last = now.steps.at(-1);
    const share = now.coverage.samples > 0 ? now.coverage.uncovered_samples / now.coverage.samples : 0;
    grown.replaceChildren(figures([
      ["Quads", count(now.quads)], ["Patches", count(now.patch_count)], ["Steps", count(now.step_count)],
      ["Uncovered", percent(share)], ["Folded quads", count(last?.quality.folded_quads)],
      ["Corners off 90°", last ? `${last.quality.mean_angle_deviation_deg.toFixed(1)}°` : "–"]]));
    chart.hidden = table.hidden = false;
    drawBounds(bounds, last);
    table.replaceChildren(stepTable(now.steps));
    drawSteps(chart, now.steps);
    await refreshMeshes();
    const quads = meshOf(now.mesh) ?? await client.meshes.get(now.mesh);
    const source = meshOf(now.source);
    drawMade(quads, source);
    distance.hidden = !last;
    drawChoices();
    await picture.showQuads(source, quads, now);
  }

  async function mapError() {
    if (heat.getAttribute("aria-pressed") === "true") {
      heat.setAttribute("aria-pressed", "false");
      await picture.hideError();
      return;
    }
    outcome.textContent = "Measuring how far the surface lies from the quads";
    const last = current?.steps.at(-1);
    const result = await picture.showError(distanceOf(last)?.upper);
    if (!result) return;
    heat.setAttribute("aria-pressed", "true");
    const isPart = Boolean(last?.uncovered_points || last?.beyond_points);
    outcome.textContent = isPart ? "What no patch covers is beyond the scale."
      : `The surface lies ${percent(result.mean.upper_relative)} of its diagonal from the quads in the mean, ${percent(result.max.upper_relative)} at most`;
  }

  /** @type {LayoutBrief[]} */
  let layouts = [];
  /** @type {ReconstructionBrief[]} */
  let all = [];
  const chosenLayout = () => side.querySelector("select[name=layout]") instanceof HTMLSelectElement
    ? /** @type {HTMLSelectElement} */ (side.querySelector("select[name=layout]")).value : "";

  /** An address may name the quad mesh alone. */
  async function findSource() {
    const wanted = parameter("reconstruction");
    if (wanted === null || parameter("a") !== null) return;
    state.a = (await client.reconstructions.get(wanted)).source;
    setParameters({ a: state.a });
    changed("choice");
  }

  /** A job that the address names, which is opened once. */
  let job = parameter("job");

  async function openAll() {
    const source = state.a;
    [layouts, all] = [[], []];
    if (source !== null) {
      for await (const brief of client.layouts.list({ pageSize: 1000, mesh: source })) if (!isHeld(brief.id)) layouts.push(brief);
      for await (const brief of client.reconstructions.list({ pageSize: 1000 })) if (brief.source === source) all.push(brief);
    }
    if (source !== state.a) return;
    const wanted = parameter("reconstruction");
    const found = all.find(({ id }) => id === wanted) ?? (parameter("layout") ? undefined : all.at(-1));
    const asked = job;
    job = null;
    if (asked) {
      await showSource();
      await once.open(asked);
    } else if (found) await accept(await client.reconstructions.get(found.id));
    else await showSource();
  }

  async function showSource() {
    const mesh = meshOf(state.a);
    current = null;
    isAtOnce = false;
    once.forget();
    setParameters({ job: null });
    distance.hidden = download.hidden = true;
    grown.replaceChildren();
    outcome.textContent = layouts.length > 0 || !mesh ? "" : "There is no layout on this surface yet: sketch one first.";
    drawTools(mesh ? [mesh] : [], {});
    drawChoices();
    await picture.showSource(mesh, "Choose a surface.");
  }

  async function begin() {
    outcome.textContent = "Finding the patch of every place of the surface";
    try {
      const made = await client.reconstructions.create({ layout: chosenLayout() });
      all.push(made);
      await accept(made);
      outcome.textContent = "One quad a patch; refine it step by step, or to the goal.";
    } finally {
      if (!current) outcome.textContent = "";
    }
  }

  async function takeEdits() {
    if (!current) return;
    const now = await client.reconstructions.takeLayout(current.id, chosenLayout());
    await accept(now);
    outcome.textContent = now.redone_patches === 0 ? "No patch has changed." : `${count(now.redone_patches)} of ${count(now.patch_count)} patches computed again.`;
  }

  function drawChoices() {
    const before = chosenLayout() || (parameter("layout") ?? layouts.at(-1)?.id ?? "");
    const none = /** @type {[string, string][]} */ (layouts.length > 0 ? [] : [["", "none yet"]]);
    const layout = select("layout", [...none, ...layouts.map((brief) => /** @type {[string, string]} */ ([brief.id, `of ${time(brief.created)}${brief.complete ? ", closed" : ""}`]))], before);
    const options = /** @type {[string, string][]} */ (all.map((brief) => [brief.id, `of ${time(brief.created)}, ${count(brief.id === current?.id ? current.quads : brief.quads)} quads`]));
    const mesh = select("reconstruction", [["", "none yet"], ...options], current?.id ?? "");
    layout.addEventListener("change", () => setRunning(isRunning));
    mesh.addEventListener("change", () => run(async () => (mesh.value ? accept(await client.reconstructions.get(mesh.value)) : showSource())));
    side.replaceChildren(h("div", { className: "whole" }, meshChoice("a", { words: "Surface" })), h("label", {}, "Layout", layout), h("label", {}, "Quad mesh", mesh));
    setRunning(isRunning);
  }

  let source = "nothing yet";
  function onChoice() {
    const key = `${state.a} ${state.hasMeshes}`;
    if (key === source) return;
    source = key;
    once.leave();
    if (state.hasMeshes) openAll().catch(sayFault);
  }

  const before = { wire: look.wire };
  setLook({ heat: false, structure: true, wire: true });
  distance.hidden = download.hidden = true;
  drawChoices();
  run(findSource).then(onChoice);
  const off = [on(["meshes", "choice"], onChoice), on("theme", () => { if (current) drawSteps(chart, current.steps); })];
  return () => {
    off.forEach((each) => each());
    runner.isStopped = true;
    once.leave();
    picture.forgetError();
    setLook(before);
  };
}

/** @param {Goal} wanted @returns {Record<import("../../js/types.js").StepResult["stopped_by"], string>} */
function endings({ max_quads: most }) {
  return {
    steps: "Refined", edge_length: "Done", hausdorff: "Done: the distance is within the goal", canceled: "Stopped after the last whole step",
    max_quads: `Done: one more step would make ${most ? `more than ${count(most)}` : "too many"} quads`,
  };
}
