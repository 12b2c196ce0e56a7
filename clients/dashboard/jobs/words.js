// Jobs in words: what was asked, of what, and the answer.

import { textOfPose } from "../core/pose.js";
import { count, length } from "../core/format.js";
import { nameOf } from "../core/state.js";
import { multiply } from "../view/transform.js";

/** @import { AlignmentResult, CollisionResult, ComparisonResult, DeviationResult, Job, MatrixResult, RemeshResult, StepResult } from "../../js/types.js" */

export const KINDS = /** @type {Record<string, string>} */ ({
  hausdorff: "Hausdorff distance", deviation: "Deviation", comparison: "Comparison", heatmap: "Heat map", project: "Nearest points", collision: "Collisions",
  self_collision: "Self-collisions", distance: "Least distance", alignment: "Alignment", reconstruction_step: "Remeshing", remesh: "Quads at once",
  matrix: "All pairs" });

/** Kinds whose view shows A where it was moved to. */
const MOVES = ["hausdorff", "deviation", "comparison", "heatmap", "alignment", "collision", "distance", "self_collision"];

/** A mesh as a request names it. @param {import("../../js/types.js").MeshName} mesh */
const wordOf = (mesh) => (typeof mesh === "string" ? nameOf(mesh) : `${nameOf(mesh.mesh)}, moved`);

/** @param {Job} job */
export function questionOf({ type, request }) {
  const points = type === "project" ? `, ${count(request.point_count)}` : "";
  const reading = request.quads === "bilinear" ? ", bilinear" : "";
  const direction = request.direction === "a_to_b" ? ", A to B" : request.direction === "b_to_a" ? ", B to A" : "";
  return `${KINDS[type] ?? type}${points}${direction}${reading}`;
}

/** @param {Job} job */
export function meshesOf({ type, request, result }) {
  if (type === "reconstruction_step") return result ? nameOf(/** @type {StepResult} */ (result).mesh) : "";
  if (type === "matrix") return `${count(request.mesh_count)} meshes`;
  return request.mesh ? wordOf(request.mesh) : `${wordOf(request.a)} → ${wordOf(request.b)}`;
}

/** @param {Job} job */
export function answerOf(job) {
  if (job.problem) return job.problem.detail;
  if (job.type === "deviation" && job.result) {
    const { mean } = /** @type {DeviationResult} */ (job.result);
    return `mean ${length(mean.lower, 5)} to ${length(mean.upper, 5)}`;
  }
  if (job.type === "comparison" && job.result) {
    const { hausdorff } = /** @type {ComparisonResult} */ (job.result).symmetric;
    return `${length(hausdorff.lower, 7)} to ${length(hausdorff.upper, 7)}`;
  }
  if (job.type.endsWith("collision") && job.result) {
    const { count: pairs } = /** @type {CollisionResult} */ (job.result);
    return pairs === 0 ? "no faces meet" : `${count(pairs)} pair${pairs === 1 ? "" : "s"} of faces meet`;
  }
  if (job.type === "matrix" && job.result) {
    const { pair_count: pairs, searched_pairs: searched } = /** @type {MatrixResult} */ (job.result);
    return `${count(pairs)} pairs, ${count(searched)} searched`;
  }
  if (job.type === "remesh" && job.result) {
    const { quads, hausdorff } = /** @type {RemeshResult} */ (job.result);
    return `${count(quads)} quads, ${length(hausdorff.lower, 5)} to ${length(hausdorff.upper, 5)} away`;
  }
  if (job.type === "reconstruction_step" && job.result) return `${count(/** @type {StepResult} */ (job.result).quads)} quads`;
  if (job.type === "alignment" && job.result) {
    const { lower, upper } = /** @type {AlignmentResult} */ (job.result).hausdorff;
    return `${length(lower, 7)} to ${length(upper ?? Infinity, 7)} is left`;
  }
  const bounds = job.result ?? job.progress;
  if (!bounds || !("lower" in bounds)) return "";
  const verdict = "verdict" in bounds && bounds.verdict ? `, ${bounds.verdict} the limit ${job.request.limit}` : "";
  return `${length(bounds.lower, 7)} to ${length(bounds.upper, 7)}${verdict}`;
}

/** What a link to Compare has of the sign and limit of a request. @param {Job["request"]} request */
const lookOf = ({ sign, limit, bands }) => `${{ outside: "&signed=1", normal: "&signed=normal" }[/** @type {string} */ (sign)] ?? ""}${limit === null || limit === undefined ? "" : `&limit=${limit}`}`
  + (bands?.length === 3 && bands[1][0] !== null ? `&limits=${bands[1]}` : "");

/** Where the page shows the result; null where it does not, as of B when it was moved for a job. @param {Job} job */
export function viewOf({ id, type, request, result }) {
  const { b, quads, reconstruction } = request;
  const first = request.a ?? request.mesh;
  const isMoved = typeof first === "object";
  if (typeof b === "object" || (isMoved && !MOVES.includes(type))) return null;
  if (type === "alignment") return result ? alignmentView(id, request, /** @type {AlignmentResult} */ (result)) : null;
  const a = isMoved ? `${first.mesh}&pose=${textOfPose(first.transform)}` : first;
  const limit = request.limit ?? null;
  const address = /** @type {Record<string, string>} */ ({
    hausdorff: `#compare?a=${a}&b=${b}&job=${id}`, deviation: `#compare?a=${a}&b=${b}&quads=${quads}&heat=1${lookOf(request)}`,
    comparison: `#compare?a=${a}&b=${b}&quads=${quads}&comparison=${id}${lookOf(request)}`, heatmap: `#compare?a=${a}&b=${b}&quads=${quads}&heat=1`,
    collision: `#collide?a=${a}&b=${b}&quads=${quads}&found=1`, distance: `#collide?a=${a}&b=${b}&quads=${quads}&found=1${limit === null ? "" : `&limit=${limit}`}`,
    self_collision: `#collide?a=${a}&b=${isMoved ? first.mesh : first}&quads=${quads}&found=1`, reconstruction_step: `#remesh?reconstruction=${reconstruction}`,
    remesh: `#remesh?a=${first}&job=${id}` });
  return address[type] ?? null;
}

/** A where the alignment brought it. @param {string} id @param {Job["request"]} request @param {AlignmentResult} result */
function alignmentView(id, { a, b, quads }, { transform }) {
  const [mesh, pose] = typeof a === "object" ? [a.mesh, multiply(transform, a.transform)] : [a, transform];
  return `#compare?a=${mesh}&b=${b}&quads=${quads}&pose=${textOfPose(pose)}&alignment=${id}`;
}
