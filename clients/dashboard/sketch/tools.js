// The tools of Sketch beside the pen: rings, links, tubes, fills, mirrors, and moving what is drawn.

import { client } from "../core/connection.js";
import { h, select } from "../core/dom.js";
import { count, length } from "../core/format.js";
import { run } from "../core/messages.js";
import { meshOf, state } from "../core/state.js";
import { currentStage } from "../view/view.js";

/** @import { CurveMark, Mirror, Point, Stroke } from "../../js/types.js" */
/** @import { Editor } from "./editor.js" */
/** @import { Target } from "./window.js" */
/** @typedef {"draw" | "ring" | "link" | "move" | "mark"} Kind what a stroke does */
/** @typedef {{ node: number } | { curve: number }} Held what a stroke begins on */

const KINDS = /** @type {[Kind, string, string][]} */ ([
  ["draw", "Draw", "A stroke is a curve"],
  ["ring", "Ring", "A click on a limb, or a stroke across it, draws a ring round it"],
  ["link", "Link", "Drag from a node to another one: a curve along the surface joins them"],
  ["move", "Move", "Drag a node, or a curve between its nodes; a node dropped on another one becomes one with it"],
  ["mark", "Mark", "A click makes a curve sharp, where the surface bends across it, then fixed as it is drawn, then smooth; a node a corner that stays, or none"],
]);
const NEXT_MARK = /** @type {Record<string, CurveMark>} */ ({ smooth: "sharp", sharp: "fixed", fixed: "smooth" });
const AXES = /** @type {Record<string, Point>} */ ({ x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] });

export class Tools {
  /**
   * @param {Editor} editor
   * @param {(name: string, action: () => Promise<unknown>, title?: string) => HTMLButtonElement} button
   */
  constructor(editor, button) {
    this.editor = editor;
    this.calls = editor.calls;
    editor.plane = () => this.mirror;
    /** @type {Kind} */
    this.kind = "draw";
    this.kinds = KINDS.map(([kind, words, title]) => h("button", {
      type: "button", title, "aria-pressed": String(kind === this.kind), onclick: () => this.take(kind) }, words));
    this.fill = button("Fill", () => this.fillAll(), "Divide all cells that have not four sides into patches");
    this.tube = button("Tube", () => this.makeTube(), "Join the rings, or cells, of the two chosen curves");
    this.row = button("Add row", () => this.splitRow(), "Divide all patches across the chosen curve");
    this.features = button("Features", () => this.addFeatures(), "Draw sharp curves along the creases and boundaries of the mesh");
    /** The plane of symmetry that was found for a mesh. @type {{ mesh: string | null, plane: Mirror } | null} */
    this.found = null;
    this.reach = 0;
    this.axis = select("mirror", [["", "none"], ["found", "the one found"], ["x", "x"], ["y", "y"], ["z", "z"]], "");
    this.axis.addEventListener("change", () => {
      this.update();
      if (this.axis.value === "found") run(() => this.findPlane());
    });
    this.image = button("Mirror", () => this.mirrorAll(), "Replace one half by the image of the other, which is kept");
    this.element = h("section", { className: "section", "aria-label": "Tools" },
      h("div", { className: "row", role: "group", "aria-label": "A stroke" }, ...this.kinds),
      h("div", { className: "row" }, this.features, this.fill, this.tube, this.row),
      h("div", { className: "row" }, h("label", { className: "inline" }, "Mirror plane across", this.axis), this.image));
  }

  /** @param {Kind} kind */
  take(kind) {
    this.kind = kind;
    this.kinds.forEach((button, place) => button.setAttribute("aria-pressed", String(KINDS[place][0] === kind)));
    currentStage()?.canvas.focus({ preventScroll: true });
  }

  update() {
    const { layout, chosen } = this.editor;
    const mesh = meshOf(state.a);
    this.features.disabled = !mesh || mesh.kind === "points";
    this.fill.disabled = !layout?.issues.some(({ kind }) => kind === "cell_sides");
    this.tube.disabled = chosen.size !== 2;
    this.row.disabled = chosen.size !== 1;
    this.image.disabled = !layout || layout.curves.length === 0 || !this.mirror;
  }

  /** The plane that edits are mirrored at, through the middle of what is shown. @returns {Mirror | undefined} */
  get mirror() {
    if (this.axis.value === "found") return this.found?.mesh === this.editor.mesh ? this.found?.plane : undefined;
    const stage = currentStage();
    const normal = AXES[this.axis.value];
    return stage && normal ? { point: /** @type {Point} */ ([...stage.frame.centre]), normal } : undefined;
  }

  /** What an automatic layout is to be its own mirror image at. @returns {"found" | Mirror | undefined} */
  get symmetry() {
    return this.axis.value === "found" ? "found" : this.mirror;
  }

  /** Finds the plane of symmetry of the mesh. */
  async findPlane() {
    const { mesh } = this.editor;
    await this.editor.edit(async (id) => {
      const [plane] = await this.calls.symmetry(id, { signal: this.editor.leaving.signal });
      this.found = plane ? { mesh, plane: { point: plane.point, normal: plane.normal } } : null;
      if (!plane) this.axis.value = "";
      this.reach = plane?.distance.upper ?? 0;
      return client.layouts.get(id);
    }, () => (this.found ? `The mirror image at the plane is at most ${length(this.reach)} from the surface.`
      : "The surface is not its own mirror image, to a hundredth of its size."));
  }

  addFeatures() {
    return this.editor.edit((id) => this.calls.features(id), (now) => {
      const added = "added_features" in now ? now.added_features ?? 0 : 0;
      return added === 0 ? "The mesh has no features that are not drawn." : `${count(added)} curve${added === 1 ? " runs" : "s run"} along features.`;
    });
  }

  /** Marks what was clicked: a node, else a curve. @param {number} node -1: none @param {number} curve -1: none */
  async mark(node, curve) {
    const { layout } = this.editor;
    if (node >= 0) {
      const corner = !layout?.corners?.includes(node);
      await this.editor.editBoth((id, both) => this.calls.mark(id, { nodes: [node], corner }, both), `Node ${node} is ${corner ? "a corner" : "no corner"} now.`);
    } else if (curve >= 0) {
      const mark = NEXT_MARK[layout?.curves.find(({ id }) => id === curve)?.mark ?? "smooth"];
      await this.editor.editBoth((id, both) => this.calls.mark(id, { curves: [curve], mark }, both), `Curve ${curve} is ${mark} now.`);
    }
  }

  fillAll() {
    return this.editor.edit((id) => this.calls.fill(id), (now) => {
      const filled = "filled_cells" in now ? now.filled_cells ?? 0 : 0;
      return `${count(filled)} cell${filled === 1 ? " is" : "s are"} filled.`;
    });
  }

  makeTube() {
    const [first, second] = this.editor.chosen.keys();
    return this.editor.editBoth((id, both) => this.calls.tube(id, first, second, both), "The rings are joined.");
  }

  splitRow() {
    const { curve } = this.editor;
    return this.editor.editBoth((id, both) => this.calls.splitChord(id, curve, {}, both), `The row of curve ${curve} is divided.`);
  }

  async mirrorAll() {
    const { mirror } = this;
    if (mirror) await this.editor.edit((id) => this.calls.mirror(id, mirror), () => "One side is the image of the other now.");
  }

  /** @param {Stroke} stroke */
  ring(stroke) {
    return this.editor.edit((id) => this.calls.ring(id, stroke), (now) => {
      const added = "changed" in now ? now.changed.added_curves.length : 0;
      return `A ring is drawn; ${count(added)} curve${added === 1 ? " is" : "s are"} new.`;
    });
  }

  /**
   * @param {Held} held
   * @param {Target | null} target
   * @param {Stroke} stroke from where it was held to where it was dropped
   */
  async drop(held, target, stroke) {
    const node = target?.kind === "node" ? this.nodeOf(target.point) : -1;
    if (this.kind === "link") {
      if (!("node" in held) || node < 0 || node === held.node) throw new Error("A link goes from a node to another node; there is none.");
      await this.editor.editBoth((id, both) => this.calls.link(id, held.node, node, both), `Nodes ${held.node} and ${node} are linked.`);
    } else if (!("node" in held)) {
      await this.editor.editBoth((id, both) => this.calls.slide(id, held.curve, stroke, both), `Curve ${held.curve} is bent.`);
    } else if (node >= 0 && node !== held.node) {
      await this.editor.editBoth((id, both) => this.calls.mergeNodes(id, node, held.node, both), `Nodes ${node} and ${held.node} are one now.`);
    } else {
      await this.editor.editBoth((id, both) => this.calls.moveNode(id, held.node, stroke, both), `Node ${held.node} is moved.`);
    }
  }

  /** @param {Point} point */
  nodeOf(point) {
    return this.editor.layout?.nodes.findIndex((node) => node.every((value, k) => value === point[k])) ?? -1;
  }

  /**
   * What a stroke at a place of the window would hold with this tool.
   * @param {Target | null} target what is there
   * @param {number} curve its curve, if it is on one, else -1
   * @returns {Held | null}
   */
  held(target, curve) {
    if (!target || (this.kind !== "link" && this.kind !== "move")) return null;
    if (target.kind === "node") return { node: this.nodeOf(target.point) };
    return this.kind === "move" && curve >= 0 ? { curve } : null;
  }
}
