// The page of collisions: which faces of A and B, or of A itself, meet; how the solids lie and how deep they reach into each other; and
// how far apart the two are.

import { choiceKey, meshChoice } from "../core/choice.js";
import { NUMBER, h, numberOf, select } from "../core/dom.js";
import { run } from "../core/messages.js";
import { keepPose, moved, poseOfA, setPoseParameter } from "../core/pose.js";
import { parameter, setParameters } from "../core/route.js";
import { meshOf, on, state } from "../core/state.js";
import { forgetEye, hasEye, keepLook, placeEye } from "../view/link.js";
import { drawTools } from "../view/tools.js";
import { setLook, show } from "../view/view.js";
import { Clearance } from "./clearance.js";
import { Contacts } from "./contacts.js";
import { Solids } from "./solids.js";

/** @import { Wish } from "../view/stage.js" */

/** The reading of quads, and whether the meshes are taken for solids, as it was left. */
const settings = { quads: "triangles", isSolid: true, limit: "" };

/** @param {HTMLElement} panel */
export function showCollide(panel) {
  const page = new Collide(panel);
  return () => page.leave();
}

class Collide {
  /** @param {HTMLElement} panel */
  constructor(panel) {
    const reading = parameter("quads") ?? "";
    if (["triangles", "bilinear"].includes(reading)) settings.quads = reading;
    settings.limit = parameter("limit") ?? settings.limit;
    if (parameter("solid")) settings.isSolid = parameter("solid") !== "0";
    this.sides = h("div", { className: "form whole" });
    this.quads = select("quads", [["triangles", "two triangles"], ["bilinear", "a bilinear patch"]], settings.quads);
    this.limit = h("input", { name: "limit", inputMode: "decimal", value: settings.limit, placeholder: "none", autocomplete: "off", pattern: NUMBER, title: "a number" });
    this.solid = h("input", { name: "solid", type: "checkbox", checked: settings.isSolid });
    this.find = h("button", { type: "submit", className: "primary" }, "Find collisions");
    this.limitField = h("label", {}, "Clearance wanted, in the meshes' unit", this.limit);
    this.solidField = h("label", { className: "check whole" }, this.solid, "As solids: is one inside of the other, and how deep?");
    this.pose = h("div", { className: "row whole", id: "moved" }, h("span", { className: "muted" }, "A is moved, as Compare aligned it."),
      h("button", { type: "button", onclick: () => this.putBack() }, "Back to where it lies"));
    this.form = h("form", { className: "form", "aria-label": "Collision" }, this.sides, this.pose, h("label", {}, "A quad is", this.quads), this.limitField, this.solidField,
      h("div", { className: "row whole" }, this.find));
    const ways = { quads: () => /** @type {any} */ (settings.quads) };
    this.contacts = new Contacts(ways);
    this.solids = new Solids(ways);
    this.clearance = new Clearance(ways);
    this.view = "nothing yet";
    this.drawn = this.pair = "";
    this.asked = 0;
    panel.append(h("section", { className: "section", "aria-labelledby": "collide-title" },
      h("header", {}, h("h2", { id: "collide-title" }, "Collide")), this.form, this.contacts.element), this.solids.element, this.clearance.element);
    this.form.addEventListener("change", () => this.onForm());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.forgetAll();
      run(() => this.search());
    });
    setPoseParameter();
    setLook({ heat: false, structure: false });
    this.stopLook = keepLook();
    this.isRestoring = parameter("found") !== null;
    this.draw();
    this.off = on(["meshes", "choice"], () => this.draw());
  }

  /** Is A asked about itself? */
  get isSelf() {
    return state.b === null || state.b === state.a;
  }

  onForm() {
    const reading = settings.quads;
    Object.assign(settings, { quads: this.quads.value, isSolid: this.solid.checked, limit: this.limit.value.trim() });
    setParameters({ quads: settings.quads, solid: settings.isSolid ? null : 0, limit: settings.limit });
    if (settings.quads === reading) return;
    this.forgetAll();
    this.drawView();
  }

  /** A lies where its file has it again. */
  putBack() {
    keepPose(null);
    setPoseParameter();
    this.forgetAll();
    this.draw();
  }

  /** Faces that meet first, which is soon known; then the solids, and the clearance. */
  async search() {
    const { b } = state;
    if (state.a === null) return;
    const a = moved();
    const mine = ++this.asked;
    this.solids.forget();
    this.clearance.forget();
    this.find.disabled = true;
    try {
      const isFlight = !hasEye();
      const result = await this.contacts.search(a, this.isSelf ? null : b, isFlight);
      if (mine !== this.asked || !result) return;
      setParameters({ found: 1 });
      if (this.isSelf || b === null) return;
      const limit = numberOf(settings.limit);
      await Promise.all([
        settings.isSolid ? this.solids.search(a, b) : null,
        limit !== null || !result.collides ? this.clearance.search(a, b, limit, isFlight && !result.collides) : null]);
    } finally {
      if (mine === this.asked) this.find.disabled = state.a === null;
    }
  }

  /** Another question: a link says nothing of what was found before. */
  forgetAll() {
    this.forget();
    this.isRestoring = false;
    forgetEye();
    setParameters({ found: null, contact: null });
  }

  forget() {
    this.asked++;
    for (const part of [this.contacts, this.solids, this.clearance]) part.forget();
    setLook({ through: false });
  }

  drawView() {
    /** @type {Wish[]} */
    const wishes = [];
    for (const role of /** @type {const} */ (["a", "b"])) {
      const mesh = meshOf(state[role]);
      const isTwice = role === "b" && state.b === state.a;
      if (mesh && !isTwice) wishes.push({ mesh, role, isBilinear: settings.quads === "bilinear", isGhost: role === "b", transform: role === "a" ? poseOfA() : null });
    }
    const key = wishes.map(({ mesh, isBilinear, transform }) => `${mesh.id} ${mesh.revision} ${isBilinear} ${transform}`).join();
    if (key === this.view) return;
    this.view = key;
    drawTools(wishes.map(({ mesh }) => mesh));
    show(wishes, "Choose a mesh to search for collisions.").then((isWhole) => { if (isWhole) this.onWhole(); });
  }

  /** What is to be shown has come. */
  onWhole() {
    placeEye();
    if (this.isRestoring) run(() => this.search());
    else run(() => this.contacts.paint());
    this.isRestoring = false;
  }

  draw() {
    if (choiceKey() !== this.drawn) this.sides.replaceChildren(meshChoice("a"), meshChoice("b", { none: "A itself" }));
    this.drawn = choiceKey();
    const pair = `${state.a} ${state.b}`;
    if (this.pair !== "" && pair !== this.pair) {
      keepPose(null);
      setPoseParameter();
      this.forgetAll();
    }
    this.pair = pair;
    this.find.disabled = state.a === null;
    this.pose.hidden = poseOfA() === null;
    this.limitField.hidden = this.solidField.hidden = this.isSelf;
    this.drawView();
  }

  leave() {
    this.off();
    this.stopLook();
    this.forget();
  }
}
