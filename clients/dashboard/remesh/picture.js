// What the view shows of a reconstruction: the quads as they grow, or the surface in the colours of its distance from them.

import { measureDeviation } from "../compare/deviation.js";
import { GOOD_SHARE } from "../compare/heat.js";
import { makeLegend } from "../compare/legend.js";
import { client } from "../core/connection.js";
import { byId } from "../core/dom.js";
import { Search } from "../core/search.js";
import { heat } from "../view/loader.js";
import { currentStage, setLook, show } from "../view/view.js";

/** @import { Mesh, Reconstruction, ReconstructionPatches } from "../../js/types.js" */
/** @import { Wish } from "../view/stage.js" */

export class Picture {
  constructor() {
    /** Is the surface shown through the quads? */
    this.hasSource = false;
    this.isError = false;
    /** Of the quads that are shown. @type {ReconstructionPatches | null} */
    this.patches = null;
    /** @type {{ source: Mesh | undefined, quads: Mesh } | null} */
    this.meshes = null;
    this.search = new Search();
  }

  /** @param {boolean} isGradual */
  wishes(isGradual) {
    if (!this.meshes) return [];
    const { source, quads } = this.meshes;
    /** @type {Wish[]} */
    const wishes = source ? [{ mesh: source, role: "a", isBilinear: false, isGhost: !this.isError, isHidden: !this.isError && !this.hasSource }] : [];
    return [...wishes, /** @type {Wish} */ ({ mesh: quads, role: "b", isBilinear: false, isHidden: this.isError, isGradual })];
  }

  /** Shows the surface alone. @param {Mesh | undefined} source @param {string} emptyWords */
  async showSource(source, emptyWords) {
    this.forgetError();
    this.meshes = this.patches = null;
    await show(source ? [{ mesh: source, role: "a", isBilinear: false }] : [], emptyWords);
  }

  /**
   * Shows the quads in place of those before, patch by patch.
   * @param {Mesh | undefined} source
   * @param {Mesh} quads
   * @param {Reconstruction} now
   */
  async showQuads(source, quads, now) {
    this.forgetError();
    const isChange = this.meshes?.quads.id !== quads.id;
    this.meshes = { source, quads };
    const [patches, isWhole] = await Promise.all([client.reconstructions.patches(now.id), show(this.wishes(isChange))]);
    const stage = currentStage();
    if (isWhole && isChange && stage) {
      const { revealPatches } = await import("./reveal.js");
      await revealPatches(stage, this.patches, patches);
    }
    this.patches = patches;
  }

  /**
   * Shows quads that came at once.
   * @param {Mesh | undefined} source
   * @param {Mesh} quads
   */
  async showAtOnce(source, quads) {
    this.forgetError();
    this.meshes = { source, quads };
    this.patches = null;
    await show(this.wishes(false));
  }

  /** @param {boolean} isShown */
  async setSource(isShown) {
    this.hasSource = isShown;
    await show(this.wishes(false));
  }

  /**
   * Measures and paints how far each place of the surface lies from the quads.
   * @param {number | null} [most] what is colours' end; what lies farther away is not covered
   */
  async showError(most) {
    const { meshes } = this;
    if (!meshes?.source) return null;
    const { result } = await measureDeviation(this.search, { a: meshes.source.id, b: meshes.quads.id, quads: "triangles" });
    if (this.meshes !== meshes) return null;
    this.isError = true;
    await show(this.wishes(false));
    const [model, quads] = [currentStage()?.models.get("a"), currentStage()?.models.get("b")];
    if (!model?.isWhole || !quads?.isWhole || this.meshes !== meshes) return null;
    const high = Math.min(most || Infinity, result.max.upper) || 1;
    const { error } = await heat(model, quads, { quads: "triangles", telling: "none", target: high * GOOD_SHARE });
    const scale = { low: 0, high, isSigned: false, limits: null };
    setLook({ heat: true, scale });
    const isClamped = high < result.max.upper;
    byId("stage-legend").replaceChildren(makeLegend(scale, {
      title: isClamped ? "Distance from the quads, of what they cover" : "Distance of the surface from the quads", isClamped, error }));
    return result;
  }

  forgetError() {
    this.search.leave();
    this.isError = false;
    byId("stage-legend").replaceChildren();
    setLook({ heat: false });
  }

  async hideError() {
    this.forgetError();
    await show(this.wishes(false));
  }
}
