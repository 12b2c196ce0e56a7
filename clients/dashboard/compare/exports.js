// What can be exported: a picture, the numbers as CSV, a link.

import { download, h } from "../core/dom.js";
import { say } from "../core/messages.js";
import { writeLook } from "../view/link.js";
import { currentStage } from "../view/view.js";
import { drawLegend } from "./legend.js";

/** @import { Labels } from "../view/labels.js" */
/** @import { Heat } from "./heat.js" */
/** @import { DeviationMap } from "./map.js" */
/** @import { Measurement } from "./measurement.js" */

/** The bounds as they came, a line each. @param {Measurement} measurement */
export function saveBounds(measurement) {
  const names = /** @type {const} */ (["elapsed_ms", "lower", "upper", "iterations", "projections"]);
  const lines = [names.join(","), ...measurement.samples.map((sample) => names.map((name) => sample[name] ?? "").join(","))];
  download(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), "bounds.csv");
}

/** Words for sides from -1 to 1. */
const SIDES = ["inside", "neither", "outside"];

/** The distances at A's vertices, with their sides where these are known. @param {Heat} heat */
export function saveDistances({ deviation, sides }) {
  const lines = [sides ? "vertex,distance,side" : "vertex,distance"];
  deviation?.distances.forEach((distance, vertex) => lines.push(sides ? `${vertex},${distance},${SIDES[sides[vertex] + 1]}` : `${vertex},${distance}`));
  download(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), "distances.csv");
}

/** The view, with labels, and with a legend when there is a heat map. @param {DeviationMap} map @param {Labels | null} places */
export async function savePicture(map, places) {
  const stage = currentStage();
  if (!stage) {
    say("There is no 3D view to take a picture of.", { isFault: true });
    return;
  }
  const view = await createImageBitmap(await stage.toPng());
  const canvas = h("canvas", { width: view.width, height: view.height });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.drawImage(view, 0, 0);
  const { scale } = map.heat;
  for (const labels of [map.probe?.labels, places]) {
    if (labels) (await import("../view/labels.js")).drawLabels(context, labels);
  }
  if (scale) drawLegend(context, scale, map.heat.wordsOf(map.names));
  canvas.toBlob((blob) => { if (blob) download(blob, "view.png"); }, "image/png");
}

/** Copies the address, which brings others to the same view. */
export async function copyLink() {
  writeLook();
  try {
    await navigator.clipboard.writeText(location.href);
    say("The link to this view is copied.");
  } catch {
    say("The link to this view is in the address bar; the browser does not let the page copy it.");
  }
}
