// The camera and the look in the address: a link opens the same view again.

import { parameter, setParameters } from "../core/route.js";
import { on } from "../core/state.js";
import { currentStage, look, setLook } from "./view.js";

/** Turning a mesh changes the camera with each frame; the address has it when it rests. */
const REST_MS = 250;

/** The camera that the address came with, until another question is asked. @type {string | null} */
let brought = null;
let isPlaced = false;

/** Did the address say whence to look? Then nothing flies to a place by itself. */
export const hasEye = () => brought !== null;

/** Another question leads the view elsewhere. */
export const forgetEye = () => { brought = null; };

/** Puts the camera where the address has it, once what it looks at is there. */
export function placeEye() {
  if (brought === null || isPlaced) return;
  isPlaced = true;
  currentStage()?.eye.fromText(brought);
}

/** Puts camera and look into the address. */
export function writeLook() {
  const stage = currentStage();
  if (!stage || stage.wishes.length === 0 || (brought !== null && !isPlaced)) return;
  setParameters({ eye: stage.eye.toText(), edges: look.wire ? 1 : null, through: look.through ? 1 : null });
}

/**
 * Takes up what the address says of the look, and keeps it there from now on.
 * @returns {() => void} what ends it
 */
export function keepLook() {
  brought = parameter("eye");
  isPlaced = false;
  setLook({ wire: parameter("edges") ? true : look.wire, through: parameter("through") !== null });
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const off = on(["eye", "through", "look"], () => {
    clearTimeout(timer);
    timer = setTimeout(writeLook, REST_MS);
  });
  return () => {
    off();
    clearTimeout(timer);
  };
}
