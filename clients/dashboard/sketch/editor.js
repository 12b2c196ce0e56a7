// A layout at work: what is chosen of it, its edits one after the other, and what the last one did.

import { ProblemError } from "../js/index.js";
import { LayoutTools } from "../js/layout_tools.js";
import { client } from "../core/connection.js";
import { deleteLater, isHeld } from "../core/deletion.js";
import { count } from "../core/format.js";

/** @import { EditedLayout, Layout, LayoutBrief, Mirror, Point, Stroke } from "../../js/types.js" */

export class Editor {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    this.calls = new LayoutTools(client.layouts);
    /** The plane at which edits are mirrored. @type {() => Mirror | undefined} */
    this.plane = () => undefined;
    /** Ends what takes long when the surface or the page is left. */
    this.leaving = new AbortController();
    /** @type {string | null} */
    this.mesh = null;
    /** Those of the mesh. @type {LayoutBrief[]} */
    this.layouts = [];
    /** null before the first stroke. @type {Layout | null} */
    this.layout = null;
    /** The chosen curves, and where each was touched. @type {Map<number, Point>} */
    this.chosen = new Map();
    this.isRedrawing = false;
    /** What the last edit did. */
    this.words = "";
    /** @type {Promise<unknown>} */
    this.before = Promise.resolve();
  }

  /** Takes up the wanted layout of a mesh, else its newest one. @param {string | null} mesh @param {string | null} wanted */
  async open(mesh, wanted) {
    this.leave();
    this.mesh = mesh;
    this.layouts = [];
    this.take(null);
    if (mesh === null) return;
    /** @type {LayoutBrief[]} */
    const all = [];
    for await (const brief of client.layouts.list({ pageSize: 1000, mesh })) if (!isHeld(brief.id)) all.push(brief);
    const found = all.find(({ id }) => id === wanted) ?? all[all.length - 1];
    const layout = found ? await client.layouts.get(found.id) : null;
    if (this.mesh !== mesh) return;
    this.layouts = all;
    this.take(layout);
  }

  /** What is being made or looked for is not wanted any more. */
  leave() {
    this.leaving.abort();
    this.leaving = new AbortController();
  }

  /** @param {Layout | null} layout @param {string} [words] */
  take(layout, words = "") {
    this.layout = layout;
    this.chosen.clear();
    this.isRedrawing = false;
    this.words = words;
    this.onChange();
  }

  /**
   * Makes a layout of the whole surface, as a new one beside those that are there.
   * @param {{ quad_count?: number, patches?: number, symmetry?: "found" | Mirror }} wanted
   */
  async make(wanted) {
    const { mesh } = this;
    if (mesh === null) return;
    const made = await client.layouts.create({ mesh, auto: true, ...wanted }, { signal: this.leaving.signal });
    if (this.mesh !== mesh) return;
    this.layouts.push(made);
    this.take(made, made.issues.length === 0 ? "" : "Not all cells are patches: correct them, or make another layout.");
  }

  /** @param {string} id */
  async choose(id) {
    this.take(id === "" ? null : await client.layouts.get(id));
  }

  /** The only curve that is chosen, or -1. */
  get curve() {
    return this.chosen.size === 1 ? /** @type {number} */ (this.chosen.keys().next().value) : -1;
  }

  /**
   * @param {(id: string) => Promise<Layout | EditedLayout>} action
   * @param {(now: Layout | EditedLayout) => string} describe
   */
  edit(action, describe) {
    const next = this.before.then(async () => {
      if (!this.layout && this.mesh !== null) {
        this.layout = await client.layouts.create({ mesh: this.mesh });
        this.layouts.push(this.layout);
      }
      if (!this.layout) return;
      const now = await action(this.layout.id).catch((error) => {
        if (!(error instanceof ProblemError) || error.status !== 422) throw error;
        this.words = `Nothing has changed: ${error.detail}.`;
      });
      if (now) this.take(now, describe(now));
      else this.onChange();
    });
    this.before = next.catch(() => {});
    return next;
  }

  /**
   * An edit on both sides of the plane, where there is one.
   * @param {(id: string, options: { mirror?: Mirror }) => Promise<EditedLayout>} action
   * @param {string} words
   */
  editBoth(action, words) {
    const mirror = this.plane();
    return this.edit((id) => action(id, { mirror }), (now) => (
      "mirrored" in now && now.mirrored === false ? `${words} It has no mirror image: only this side has changed.` : words));
  }

  /** @param {Stroke} stroke */
  stroke(stroke) {
    if (!this.isRedrawing) return this.edit((id) => client.layouts.stroke(id, stroke), describeStroke);
    const { curve } = this;
    return this.editBoth((id, both) => this.calls.redraw(id, curve, stroke, both), `Curve ${curve} is redrawn.`);
  }

  split() {
    const { curve } = this;
    const point = /** @type {Point} */ (this.chosen.get(curve));
    return this.editBoth((id, both) => this.calls.split(id, curve, point, both), `Curve ${curve} is cut in two.`);
  }

  merge() {
    const [first, second] = this.chosen.keys();
    return this.editBoth((id, both) => this.calls.merge(id, first, second, both), `Curves ${first} and ${second} are one now.`);
  }

  async delete() {
    for (const curve of [...this.chosen.keys()]) {
      // It may be the mirror image of the one before.
      if (!this.layout?.curves.some(({ id }) => id === curve)) continue;
      await this.editBoth((id, both) => this.calls.deleteCurve(id, curve, both), `Curve ${curve} is deleted.`);
    }
  }

  /** @param {"from" | "to"} end @param {Point} point @param {number} radius */
  snap(end, point, radius) {
    const { curve } = this;
    return this.edit((id) => client.layouts.snap(id, curve, { end, point, radius }), () => `Curve ${curve} ends elsewhere now.`);
  }

  undo() {
    return this.edit((id) => client.layouts.undo(id), () => "Undone.");
  }

  redo() {
    return this.edit((id) => client.layouts.redo(id), () => "Done again.");
  }

  /** Deletes the whole layout, which can be undone for a while. */
  discard() {
    const { layout: gone, mesh } = this;
    if (!gone) return;
    deleteLater({
      id: gone.id, words: "The layout is deleted.", commit: () => client.layouts.delete(gone.id),
      onChange: () => {
        if (this.mesh !== mesh) return;
        this.layouts = this.layouts.filter(({ id }) => id !== gone.id);
        if (!isHeld(gone.id)) this.layouts.push(gone);
        this.take(isHeld(gone.id) ? null : gone);
      },
    });
  }
}

/** @param {Layout | EditedLayout} now */
function describeStroke(now) {
  if (!("stroke" in now) || !now.stroke) return "";
  const { stroke: { curve }, changed: { added_curves: added, changed_curves: altered } } = now;
  const cut = altered.filter((id) => id !== curve);
  const parts = [
    added.includes(curve) ? `Curve ${curve} is new` : `The stroke goes on from curve ${curve}: joined`,
    ...(cut.length > 0 ? [`curve${cut.length > 1 ? "s" : ""} ${cut.join(" and ")} ${cut.length > 1 ? "are" : "is"} cut where it meets ${cut.length > 1 ? "them" : "it"}`] : []),
  ];
  return `${parts.join("; ")}.${describeMissed(now)}`;
}

/** @param {Layout | EditedLayout} now */
function describeMissed(now) {
  const missed = ("stroke" in now && now.stroke?.missed_points) || 0;
  return missed > 0 ? ` ${count(missed)} of its points met nothing.` : "";
}
