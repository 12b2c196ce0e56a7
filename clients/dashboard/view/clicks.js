// Clicks on the view, which are not the ends of a turn of the eye. Who listens last gets them.

/** How far the pointer may go meanwhile, in pixels. */
const CLICK_LENGTH = 4;

/** @type {WeakMap<HTMLCanvasElement, object[]>} */
const listening = new WeakMap();

/**
 * @param {HTMLCanvasElement} canvas
 * @param {(x: number, y: number) => void} onClick in pixels from the left upper corner
 * @returns {() => void} what ends it
 */
export function listenToClicks(canvas, onClick) {
  const me = {};
  listening.set(canvas, [...listening.get(canvas) ?? [], me]);
  /** @type {[number, number] | null} */
  let pressed = null;
  const at = (/** @type {PointerEvent} */ event) => {
    const box = canvas.getBoundingClientRect();
    return /** @type {[number, number]} */ ([event.clientX - box.left, event.clientY - box.top]);
  };
  const press = (/** @type {PointerEvent} */ event) => { pressed = event.button === 0 ? at(event) : null; };
  const release = (/** @type {PointerEvent} */ event) => {
    const [x, y] = at(event);
    const isClick = pressed && Math.hypot(x - pressed[0], y - pressed[1]) < CLICK_LENGTH;
    pressed = null;
    if (isClick && listening.get(canvas)?.at(-1) === me) onClick(x, y);
  };
  canvas.addEventListener("pointerdown", press);
  canvas.addEventListener("pointerup", release);
  return () => {
    listening.set(canvas, (listening.get(canvas) ?? []).filter((other) => other !== me));
    canvas.removeEventListener("pointerdown", press);
    canvas.removeEventListener("pointerup", release);
  };
}
