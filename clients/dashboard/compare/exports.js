// What can be taken along: a picture, the numbers as CSV, a link.

import { download, h } from "../core/dom.js";
import { say } from "../core/messages.js";
import { address } from "../core/route.js";
import { scaleColour } from "../view/colours.js";
import { currentStage } from "../view/view.js";
import { length } from "../core/format.js";

/** @import { Measurement } from "./measurement.js" */
/** @import { Deviation } from "./deviation.js" */

/** The bounds as they came, a line each. @param {Measurement} measurement */
export function saveBounds(measurement) {
  const names = /** @type {const} */ (["elapsed_ms", "lower", "upper", "iterations", "projections"]);
  const lines = [names.join(","), ...measurement.samples.map((sample) => names.map((name) => sample[name] ?? "").join(","))];
  download(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), "bounds.csv");
}

/** The distances at A's vertices. @param {Deviation} deviation */
export function saveDistances({ distances }) {
  const lines = ["vertex,distance"];
  distances.forEach((distance, vertex) => lines.push(`${vertex},${distance}`));
  download(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), "distances.csv");
}

/** The view, with the colour bar when there is a heat map. @param {number | null} top */
export async function savePicture(top) {
  const stage = currentStage();
  if (!stage) {
    say("There is no 3D view to take a picture of.", { isFault: true });
    return;
  }
  const view = await createImageBitmap(await stage.toPng());
  const canvas = h("canvas", { width: view.width, height: view.height });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.drawImage(view, 0, 0);
  if (top !== null) drawBar(context, view.width, view.height, top);
  canvas.toBlob((blob) => { if (blob) download(blob, "view.png"); }, "image/png");
}

/** @param {CanvasRenderingContext2D} context @param {number} width @param {number} height @param {number} top */
function drawBar(context, width, height, top) {
  const ratio = devicePixelRatio;
  const size = Math.min(260 * ratio, width / 2);
  const left = width - size - 16 * ratio;
  const y = height - 40 * ratio;
  for (let i = 0; i < size; i++) {
    context.fillStyle = `rgb(${scaleColour(i / size).map((x) => Math.round(255 * x)).join(" ")})`;
    context.fillRect(left + i, y, 1, 12 * ratio);
  }
  context.fillStyle = getComputedStyle(document.body).color;
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  context.fillText("0", left, y + 28 * ratio);
  context.textAlign = "right";
  context.fillText(length(top, 3), left + size, y + 28 * ratio);
}

/** Copies an address that brings others to the same view. */
export async function copyLink() {
  const stage = currentStage();
  const link = new URL(address(stage ? { eye: stage.eye.toText() } : {}), location.href).href;
  history.replaceState(null, "", link);
  try {
    await navigator.clipboard.writeText(link);
    say("The link to this view is copied.");
  } catch {
    say("The link to this view is in the address bar; the browser does not let the page copy it.");
  }
}
