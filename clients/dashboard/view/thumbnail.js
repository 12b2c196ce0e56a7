// Small pictures of meshes on no ground, drawn beside the view without making the page wait.

import { PerspectiveCamera, Scene, WebGLRenderTarget } from "three";

import { forget, load } from "./loader.js";
import { Model } from "./model.js";
import { START } from "./camera.js";

/** @import { Mesh } from "../../js/types.js" */
/** @import { Stage } from "./stage.js" */

const DISTANCE = 1.75;

/**
 * @param {Stage} stage
 * @param {Mesh} mesh
 * @param {number} width
 * @param {number} height
 * @returns {Promise<ImageData>}
 */
export async function drawThumbnail(stage, mesh, width, height) {
  await stage.rest();
  const shown = stage.models.get("a");
  if (shown?.isWhole && shown.mesh.id === mesh.id) return draw(stage, shown, width, height);
  const model = new Model(mesh, false);
  try {
    await load(model, () => {});
    await stage.rest();
    return await draw(stage, model, width, height);
  } finally {
    forget(model);
    model.dispose();
  }
}

/** @param {Stage} stage @param {Model} model @param {number} width @param {number} height */
async function draw(stage, model, width, height) {
  const { renderer } = stage;
  const scene = new Scene();
  const home = model.group.parent;
  model.letIn();
  scene.add(model.group);
  stage.dress(model, { role: "a" });
  if (model.irregular) model.irregular.visible = false;
  for (const { uniforms } of model.materials()) if (uniforms.height) uniforms.height.value = height;
  const camera = new PerspectiveCamera(35, width / height, DISTANCE - 1, DISTANCE + 1);
  camera.position.copy(START).multiplyScalar(DISTANCE);
  camera.lookAt(0, 0, 0);
  const target = new WebGLRenderTarget(width, height, { samples: 4 });
  renderer.setClearColor(0, 0);
  renderer.setRenderTarget(target);
  renderer.clear();
  renderer.render(scene, camera);
  renderer.setRenderTarget(null);
  home?.add(model.group);
  stage.mark();
  stage.apply();
  const pixels = await stage.read(target);
  target.dispose();
  const picture = new ImageData(width, height);
  for (let row = 0; row < height; row++) { // the graphics card's first row is the lowest
    picture.data.set(pixels.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
  }
  return picture;
}
