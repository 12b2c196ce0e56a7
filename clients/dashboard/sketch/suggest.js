// Curves that would bring a layout nearer to completion: thin in the view, and in a list, from which a click takes one.

import { h } from "../core/dom.js";
import { count } from "../core/format.js";
import { run } from "../core/messages.js";

/** @import { Layout, LayoutSuggestion } from "../../js/types.js" */
/** @import { Editor } from "./editor.js" */

const TAKEN_AT = 1e-6; /* of a curve's length: its ends meet the nodes that they were drawn to */

export class Suggestions {
  /**
   * @param {Editor} editor
   * @param {(name: string, action: () => Promise<unknown>, title?: string) => HTMLButtonElement} button
   * @param {() => void} onChange they are to be drawn
   */
  constructor(editor, button, onChange) {
    this.editor = editor;
    this.onChange = onChange;
    this.calls = editor.calls;
    /** @type {LayoutSuggestion[]} */
    this.all = [];
    /** The layout that they are for. @type {Layout | null} */
    this.of = null;
    this.ask = button("Suggest curves", () => this.find(), "Find curves along creases, from open ends, and across wide cells");
    this.list = h("ul", { className: "issues", "aria-label": "Suggested curves" });
    this.element = h("section", { className: "section", "aria-label": "Suggestions" }, h("div", { className: "row" }, this.ask), this.list);
  }

  /** Those for the layout as it is. @returns {LayoutSuggestion[]} */
  get shown() {
    return this.of === this.editor.layout ? this.all : [];
  }

  update() {
    this.ask.disabled = !this.editor.layout;
    this.list.replaceChildren(...this.shown.map((one, place) => h("li", {}, h("button", {
      type: "button", className: "quiet", title: "Draw this curve", onclick: () => run(() => this.take(one)),
    }, `${place + 1}: ${one.detail}`))));
  }

  async find() {
    const { layout } = this.editor;
    if (!layout) return;
    this.all = await this.calls.suggestions(layout.id, { mirror: this.editor.plane(), signal: this.editor.leaving.signal });
    this.of = layout;
    this.editor.words = this.all.length === 0 ? "There is nothing to suggest." : `${count(this.all.length)} suggested; a click on one draws it.`;
    this.onChange();
  }

  /** Draws a suggested curve, and asks again. @param {LayoutSuggestion} one */
  async take(one) {
    const [a, b] = [one.points[0], one.points[one.points.length - 1]];
    const snap = TAKEN_AT * Math.hypot(...a.map((value, k) => value - b[k]));
    const { layout: before } = this.editor;
    await this.editor.edit((id) => this.calls.addCurve(id, { points: one.points, mark: one.mark, snap }), () => "");
    if (this.editor.layout !== before) await this.find();
  }
}
