// A section through both meshes: a part of them is taken away, and the curves of the cut are drawn.

import { colour, h, select } from "../core/dom.js";
import { run } from "../core/messages.js";
import { parameter, setParameters } from "../core/route.js";
import { toggle } from "../view/tools.js";
import { currentStage, setLook } from "../view/view.js";

/** @import { Cut } from "../view/stage.js" */

const AXES = ["x", "y", "z"];
const WIDTH = 2.5;
const LAYER = "section";

export class Section {
  constructor() {
    /** @type {Cut} as it was left */
    this.cut = { axis: 0, share: 0.5, isOther: false };
    this.isOn = false;
    this.isWaiting = false;
    const [axis, share, side] = (parameter("cut") ?? "").split(",");
    if (AXES.includes(axis) && Number(share) >= 0 && Number(share) <= 1) {
      this.isOn = true;
      this.cut = { axis: AXES.indexOf(axis), share: Number(share), isOther: side === "-" };
    }
    const axes = select("axis", AXES.map((name) => [name, `across ${name}`]), AXES[this.cut.axis]);
    axes.setAttribute("aria-label", "Axis of the section");
    const slider = h("input", { type: "range", min: "0", max: "1", step: "0.005", value: String(this.cut.share), "aria-label": "Place of the section" });
    const other = toggle("Other side", "Keep what lies on the other side of the section", this.cut.isOther, (isOther) => this.change({ isOther }));
    this.more = h("span", { className: "row" }, axes, slider, other);
    this.button = toggle("Section", "Cut both meshes by a plane", this.isOn, (isOn) => {
      this.isOn = isOn;
      this.change({});
    });
    axes.addEventListener("change", () => this.change({ axis: AXES.indexOf(axes.value) }));
    slider.addEventListener("input", () => this.change({ share: Number(slider.value) }));
  }

  /** What the view's tools show of it. */
  get tools() {
    this.more.hidden = !this.isOn;
    return [this.button, this.more];
  }

  /** @param {Partial<Cut>} change */
  change(change) {
    Object.assign(this.cut, change);
    const { axis, share, isOther } = this.cut;
    this.more.hidden = !this.isOn;
    setParameters({ cut: this.isOn ? `${AXES[axis]},${share}${isOther ? ",-" : ""}` : null });
    if (this.isWaiting) return;
    this.isWaiting = true; // events may come faster than the screen shows them
    requestAnimationFrame(() => {
      this.isWaiting = false;
      run(() => this.draw());
    });
  }

  /** Cuts what is shown. */
  async draw() {
    setLook({ cut: this.isOn ? { ...this.cut } : null });
    const stage = currentStage();
    const plane = stage?.plane;
    if (!stage) return;
    if (!plane) return stage.setOverlay({}, LAYER);
    const [{ cutModel }, { toVector }] = await Promise.all([import("../view/plane.js"), import("../view/stage.js")]);
    const shown = stage.wishes.filter(({ isHidden, mesh }) => !isHidden && mesh.kind !== "points");
    stage.setOverlay({ ribbons: shown.flatMap(({ role }) => {
      const model = stage.models.get(role);
      const tint = toVector(colour(`--mesh-${role}`));
      return model?.isWhole ? cutModel(plane, model).map((points) => ({ points, colour: tint, width: WIDTH })) : [];
    }) }, LAYER);
  }

  leave() {
    setLook({ cut: null });
    currentStage()?.setOverlay({}, LAYER);
  }
}
