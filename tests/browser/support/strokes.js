// Strokes over the 3D view.

/** Looks at a point from outside, and returns where points of the mesh then are on the screen. */
export async function lookAt(page, target, points) {
  const inView = await page.evaluate(async ({ target: wanted, points: all }) => {
    const { currentStage } = await import("/dashboard/view/view.js");
    const { toWindow } = await import("/dashboard/sketch/window.js");
    const stage = currentStage();
    stage.eye.camera.position.copy(stage.toScene(wanted)).setLength(1.6);
    stage.eye.controls.target.set(0, 0, 0);
    stage.eye.controls.update();
    stage.drawNow();
    return all.map((point) => toWindow(stage, point));
  }, { target, points });
  const box = await page.locator(".canvas canvas").boundingBox();
  return inView.map(([x, y]) => [x + box.x, y + box.y]);
}

export async function draw(page, track) {
  await page.mouse.move(...track[0]);
  await page.mouse.down();
  for (const place of track.slice(1)) await page.mouse.move(...place);
  await page.mouse.up();
}

/** Waits until the view can be drawn on. */
export const waitForPen = (page) => page.locator("canvas.draws").waitFor();
