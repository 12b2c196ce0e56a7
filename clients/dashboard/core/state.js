// What the page knows, in one plain object, and who wants to be told of changes.

/** @import { Info, Mesh } from "../js/types.js" */
/** @typedef {"meshes" | "choice" | "info" | "page" | "connection" | "theme" | "through" | "eye" | "look"} Topic */

export const state = {
  /** @type {Mesh[]} in order of creation */
  meshes: [],
  /** Were the meshes read yet? */
  hasMeshes: false,
  /** @type {Info | null} */
  info: null,
  /** The mesh whose facts are shown. @type {string | null} */
  shown: null,
  /** How A is moved. @type {{ mesh: string | null, text: string | null } | null} */
  pose: null,
  /** @type {string | null} */
  a: null,
  /** @type {string | null} */
  b: null,
  page: "meshes",
  /** @type {"waiting" | "open" | "lost"} */
  connection: "waiting",
};

/** @type {Map<Topic, Set<() => void>>} */
const listeners = new Map();

/**
 * @param {Topic | Topic[]} topics
 * @param {() => void} listener
 * @returns {() => void} what makes it listen no more
 */
export function on(topics, listener) {
  const all = [topics].flat();
  for (const topic of all) listeners.set(topic, (listeners.get(topic) ?? new Set()).add(listener));
  return () => { for (const topic of all) listeners.get(topic)?.delete(listener); };
}

/** @param {...Topic} topics */
export function changed(...topics) {
  for (const topic of topics) for (const listener of [...listeners.get(topic) ?? []]) listener();
}

/** @param {string | null | undefined} id */
export const meshOf = (id) => state.meshes.find((mesh) => mesh.id === id);

/** A mesh in words, also when it is gone. @param {string | null | undefined} id */
export const nameOf = (id) => meshOf(id)?.name || id || "–";
