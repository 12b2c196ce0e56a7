// The page that remeshes: a layout grows into a quad mesh, step by step, with its distance to the source beside it.

import { measureDeviation, makeLegend } from "../compare/deviation.js";
import { client } from "../core/connection.js";
import { meshChoice } from "../core/choice.js";
import { refreshMeshes } from "../core/data.js";
import { byId, figures, h, select } from "../core/dom.js";
import { count, percent, time } from "../core/format.js";
import { run, sayFault } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, nameOf, on, state } from "../core/state.js";
import { downloads } from "../meshes/facts.js";
import { paint } from "../view/loader.js";
import { drawTools } from "../view/tools.js";
import { currentStage, setLook, show } from "../view/view.js";
import { Runner } from "./runner.js";
import { drawSteps, stepTable } from "./steps.js";

/** @import { LayoutBrief, Reconstruction, ReconstructionBrief } from "../../js/types.js" */

/** @param {HTMLElement} panel */
export function showRemesh(panel) {
  /** @type {Reconstruction | null} */
  let current = null;
  let leaveHeat = new AbortController();
  const side = h("div", { className: "form whole" });
  const quads = h("input", { name: "quads", inputMode: "numeric", value: "1000", pattern: "[0-9]*", title: "a whole number" });
  const distance = h("input", { name: "distance", inputMode: "decimal", placeholder: "any", pattern: "\\s*[0-9]*\\.?[0-9]*\\s*", title: "a number" });
  const once = h("button", { type: "button", disabled: true, onclick: () => run(() => refine(1, {})) }, "One step");
  const toGoal = h("button", { type: "submit", className: "primary", disabled: true }, "Run to the goal");
  const stop = h("button", { type: "button", disabled: true, onclick: () => run(() => runner.stop()) }, "Stop");
  const outcome = h("p", { className: "outcome muted", id: "remesh", role: "status" });
  const numbers = h("div");
  const chart = h("canvas", { className: "drawing low", role: "img", "aria-label": "Distance over the number of quads; its figures are in the table below" });
  const table = h("div");
  const heat = h("button", { type: "button", disabled: true, onclick: () => run(paintError) }, "Map the error");
  const files = h("div");
  const form = h("form", { className: "form", "aria-label": "Refinement" }, side,
    h("label", {}, "Quads, at most", quads), h("label", {}, "Until the distance is, % of diagonal", distance),
    h("div", { className: "row whole" }, once, toGoal, stop));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    run(() => refine(64, readGoal()));
  });
  panel.append(
    h("section", { className: "section", "aria-labelledby": "remesh-title" }, h("header", {}, h("h2", { id: "remesh-title" }, "Remesh")), form, outcome, numbers),
    h("section", { className: "section", "aria-labelledby": "error-title" },
      h("header", {}, h("h2", { id: "error-title" }, "Distance to the source"), heat), chart, table),
    h("section", { className: "section", "aria-label": "Download" }, files));

  const runner = new Runner(async ({ reconstruction }) => take(await client.reconstructions.get(reconstruction)));

  function readGoal() {
    return {
      ...(Number(quads.value) > 0 ? { max_quads: Number(quads.value) } : {}),
      ...(Number(distance.value) > 0 ? { hausdorff_relative: Number(distance.value) / 100 } : {}),
    };
  }

  /** @param {number} most @param {Parameters<Runner["run"]>[2]} goal */
  async function refine(most, goal) {
    if (!current) return;
    setRunning(true);
    outcome.textContent = "Refining";
    try {
      const why = await runner.run(current.id, most, goal);
      const words = { steps: "Refined", max_quads: "Done: the next step would have too many quads", edge_length: "Done", hausdorff: "Done: the distance is within the goal", canceled: "Stopped after the last whole step" };
      outcome.textContent = words[why];
    } finally {
      setRunning(false);
    }
  }

  /** @param {boolean} isRunning */
  function setRunning(isRunning) {
    once.disabled = toGoal.disabled = isRunning || !current;
    stop.disabled = !isRunning;
    heat.disabled = isRunning || !current;
  }

  /** @param {Reconstruction} now */
  async function take(now) {
    current = now;
    setParameters({ reconstruction: now.id });
    forgetHeat();
    const last = now.steps[now.steps.length - 1];
    const share = now.coverage.samples > 0 ? now.coverage.uncovered_samples / now.coverage.samples : 0;
    numbers.replaceChildren(figures([
      ["Quads", count(now.quads)], ["Patches", count(now.patch_count)], ["Steps", count(now.step_count)],
      ["Uncovered", percent(share)]]));
    chart.hidden = table.hidden = !last;
    table.replaceChildren(stepTable(now.steps));
    drawSteps(chart, now.steps);
    await refreshMeshes();
    const mesh = meshOf(now.mesh) ?? await client.meshes.get(now.mesh);
    files.replaceChildren(downloads({ ...mesh, name: `${nameOf(now.source)} ${now.quads} quads` }));
    drawTools([mesh], { hasStructure: true });
    setRunning(stop.disabled === false);
    await show([{ mesh, role: "a", isBilinear: false }]);
  }

  function forgetHeat() {
    leaveHeat.abort();
    byId("stage-legend").replaceChildren();
    setLook({ heat: false });
  }

  async function paintError() {
    const shown = current;
    if (!shown) return;
    leaveHeat = new AbortController();
    outcome.textContent = "Measuring the distances over the quads";
    const { result, distances } = await measureDeviation({ a: shown.mesh, b: shown.source, quads: "bilinear" }, leaveHeat.signal);
    const model = currentStage()?.models.get("a");
    if (current !== shown || !model?.isWhole || model.mesh.id !== shown.mesh) return;
    await paint(model, distances);
    const top = result.max.upper;
    setLook({ heat: true, top: top > 0 ? top : 1 });
    byId("stage-legend").replaceChildren(makeLegend(top, "Distance of the quads from the source"));
    outcome.textContent = `Mean ${percent(result.mean.upper_relative)}, greatest ${percent(result.max.upper_relative)} of the diagonal`;
  }

  /** @type {LayoutBrief[]} */
  let layouts = [];
  /** @type {ReconstructionBrief[]} */
  let grown = [];

  async function openAll() {
    const source = state.a;
    [layouts, grown] = [[], []];
    if (source !== null) {
      for await (const brief of client.layouts.list({ pageSize: 1000 })) if (brief.mesh === source && brief.revision + Number(brief.complete) > 0) layouts.push(brief);
      for await (const brief of client.reconstructions.list({ pageSize: 1000 })) if (brief.source === source) grown.push(brief);
    }
    if (source !== state.a) return;
    drawChoices();
    const wanted = parameter("reconstruction");
    const found = grown.find(({ id }) => id === wanted) ?? (parameter("layout") ? undefined : grown[grown.length - 1]);
    if (found) await take(await client.reconstructions.get(found.id));
    else showSource();
  }

  function showSource() {
    const mesh = meshOf(state.a);
    current = null;
    setRunning(false);
    chart.hidden = true;
    for (const place of [numbers, table, files]) place.replaceChildren();
    outcome.textContent = layouts.length > 0 || !mesh ? "" : "There is no layout on this surface yet: sketch one first.";
    drawTools(mesh ? [mesh] : [], {});
    show(mesh ? [{ mesh, role: "a", isBilinear: false }] : [], "Choose a surface that has a layout.");
  }

  async function startFrom(/** @type {string} */ layout) {
    outcome.textContent = "Finding the patch of every sample";
    try {
      const made = await client.reconstructions.create({ layout });
      grown.push(made);
      await take(made);
      outcome.textContent = "One quad a patch; refine it step by step, or to the goal.";
    } finally {
      if (!current) outcome.textContent = "";
      drawChoices();
    }
  }

  function drawChoices() {
    const layout = select("layout", layouts.map((brief) => [brief.id, `${time(brief.created)}${brief.complete ? ", whole" : ""}`]), parameter("layout") ?? layouts[layouts.length - 1]?.id ?? "");
    const mesh = select("reconstruction", [["", "none yet"], ...grown.map((brief) => /** @type {[string, string]} */ ([brief.id, `${time(brief.created)}, ${count(brief.quads)} quads`]))], current?.id ?? "");
    mesh.addEventListener("change", () => run(async () => (mesh.value ? take(await client.reconstructions.get(mesh.value)) : showSource())));
    side.replaceChildren(meshChoice("a", { words: "Surface" }), h("label", {}, "Layout", layout), h("label", {}, "Quad mesh", mesh),
      h("div", { className: "row" }, h("button", { type: "button", disabled: layouts.length === 0, onclick: () => run(() => startFrom(layout.value)) }, "Start from the layout")));
  }

  let source = "nothing yet";
  function onChoice() {
    const key = `${state.a} ${state.hasMeshes}`;
    if (key === source) return;
    source = key;
    if (state.hasMeshes) openAll().catch(sayFault);
  }

  setLook({ heat: false, structure: true });
  drawChoices();
  onChoice();
  const off = [on(["meshes", "choice"], onChoice), on("theme", () => { if (current) drawSteps(chart, current.steps); })];
  return () => {
    off.forEach((each) => each());
    runner.isStopped = true;
    forgetHeat();
  };
}
