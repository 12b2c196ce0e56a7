// Between the page and the 3D view: fetches three.js when there is something to show, and says what goes wrong.

import { byId } from "../core/dom.js";
import { say, sayFault } from "../core/messages.js";
import { changed, on } from "../core/state.js";

/** @import { Scale } from "./scale.js" */
/** @import { Cut, Stage, Wish } from "./stage.js" */

/** What the tools of the view are set to. */
export const look = {
  wire: false, patches: true, irregular: true, heat: false, disc: 1, bilinear: false, structure: true, through: false,
  /** @type {Cut | null} */
  cut: null,
  /** @type {Scale} */
  scale: { low: 0, high: 1, isSigned: false, limits: null },
};

/** @type {Promise<Stage | null> | undefined} */
let loading;
/** @type {Stage | null} */
let stage = null;
/** What was asked for last; an older answer that comes late is nobody's. */
let turn = 0;

/** The view, when it is there already. */
export const currentStage = () => stage;

/** @returns {Promise<Stage | null>} null where the view cannot be had; the page has said why */
export function openStage() {
  loading ??= make();
  return loading;
}

async function make() {
  try {
    const { Stage: Made } = await import("./stage.js");
    stage = new Made(byId("canvas"), progress, (through) => setLook({ through }));
    stage.setLook(look);
    stage.eye.controls.addEventListener("change", () => changed("eye"));
    return stage;
  } catch (error) {
    byId("stage-words").textContent = `There is no 3D view here: ${error instanceof Error ? error.message : error}.`
      + " Everything else works without it.";
    return null;
  }
}

/** @param {string} words @param {number} share */
function progress(words, share) {
  byId("stage-progress").textContent = words === "" ? "" : `${words} ${Math.round(100 * share)} %`;
}

/**
 * Flies to where points are seen, and says so where a surface hides some of them.
 * @param {number[][]} points in the space of the meshes; the first one has to be seen
 * @param {string} what they are, such as "the contact"
 * @param {number} [least] how near to go, as a share of the first mesh's diagonal
 */
export async function lookAt(points, what, least = 0.3) {
  if (!stage) return;
  const sight = await import("./sight.js");
  const places = points.map((point) => /** @type {Stage} */ (stage).toScene(point));
  const span = Math.max(...places.map((place) => place.distanceTo(places[0])));
  const found = await sight.lookAt(stage, places, Math.max(10 * span, least));
  const words = sight.wordsOf(found, what);
  if (words) say(words);
}

/**
 * Shows these meshes, the first one's frame, and no others.
 * @param {Wish[]} wishes
 * @param {string} [emptyWords] what to say when there are none
 * @returns {Promise<boolean>} false when something newer was asked for meanwhile, or nothing can be shown
 */
export async function show(wishes, emptyWords = "Choose a mesh to see it here.") {
  const mine = ++turn;
  byId("stage-empty").hidden = wishes.length > 0 && (stage !== null || !loading);
  if (wishes.length === 0) byId("stage-words").textContent = emptyWords;
  if (wishes.length === 0 && !stage) return false;
  const opened = await openStage();
  if (mine !== turn || !opened) return false;
  byId("stage-empty").hidden = wishes.length > 0;
  try {
    const done = opened.show(wishes);
    changed("choice");
    await done;
  } catch (error) {
    sayFault(error);
    return false;
  }
  return mine === turn;
}

/** @param {Partial<typeof look>} change */
export function setLook(change) {
  const before = { ...look };
  Object.assign(look, change);
  stage?.setLook(look);
  if (look.through !== before.through) changed("through");
  if (look.wire !== before.wire) changed("look");
}

on("theme", () => stage?.apply());
