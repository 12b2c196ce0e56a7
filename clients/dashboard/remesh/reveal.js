// A finer mesh takes the place of a coarser one patch by patch.

/** @import { ReconstructionPatches } from "../../js/types.js" */
/** @import { Stage } from "../view/stage.js" */

const REVEAL_MS = 450;

/** Where the triangles of each patch end. @param {ReconstructionPatches} patches */
const endsOf = ({ patches }) => patches.map(({ first_face: first, columns, rows }) => 2 * (first + columns * rows));

/**
 * @param {Stage} stage whose model b changes
 * @param {ReconstructionPatches | null} before patches of what is there, if it is of the same layout
 * @param {ReconstructionPatches} now
 */
export async function revealPatches(stage, before, now) {
  const [model, old] = [stage.models.get("b"), stage.leaving.get("b")];
  const [oldEnds, ends] = [before ? endsOf(before) : [], endsOf(now)];
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const start = performance.now();
  for (let share = 0; share < 1 && !isStill && stage.models.get("b") === model && model?.isWhole;) {
    const done = Math.floor(share * (ends.length + 1));
    model.setRange(0, ends[done - 1] ?? 0);
    if (oldEnds.length === ends.length) old?.setRange(oldEnds[done - 1] ?? 0, Infinity);
    stage.draw();
    share = (await new Promise(requestAnimationFrame) - start) / REVEAL_MS;
  }
  if (stage.models.get("b") === model) stage.endChange("b");
}
