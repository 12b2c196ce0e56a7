// Between the page and the 3D view: fetches three.js when there is something to show, and says what goes wrong.

import { byId } from "../core/dom.js";
import { sayFault } from "../core/messages.js";
import { changed, on } from "../core/state.js";

/** @import { Stage, Wish } from "./stage.js" */

/** What the tools of the view are set to. */
export const look = { wire: false, patches: true, irregular: true, heat: false, disc: 1, top: 1, bilinear: false, structure: true, signed: false };

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
    stage = new Made(byId("canvas"), progress);
    stage.setLook(look);
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
  Object.assign(look, change);
  stage?.setLook(look);
}

on("theme", () => stage?.apply());
