/**
 * Mouse, pen and fingers on a picture: move, turn, zoom and point.
 */

/**
 * @typedef {Object} PointerActions
 * @property {(right: number, down: number, isSecond: boolean) => void} drag px; `isSecond` with the second button,
 *   with Shift or with two fingers
 * @property {(factor: number, left: number, top: number) => void} zoom around a place in the picture, px
 * @property {(left: number, top: number) => void} hover a place in the picture, px
 * @property {() => void} leave the pointer is no longer over the picture
 */

const WHEEL = 0.0015; // per px of the wheel

/**
 * Call actions when pointers move on an element.
 *
 * @param {HTMLElement} element
 * @param {PointerActions} actions
 */
export function listenToPointers(element, actions) {
  const held = new Map();
  /** @returns {[number, number]} left and top, px */
  const placeOf = (event) => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const release = (event) => held.delete(event.pointerId);
  element.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, placeOf(event));
    element.setPointerCapture(event.pointerId);
  });
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);
  element.addEventListener("pointerleave", () => actions.leave());
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener("pointermove", (event) => {
    const place = placeOf(event);
    if (!held.has(event.pointerId)) {
      actions.hover(...place);
      return;
    }
    const before = [...held.values()];
    const old = held.get(event.pointerId);
    held.set(event.pointerId, place);
    const isSecond = held.size > 1 || event.shiftKey || (event.buttons & 2) !== 0;
    actions.drag((place[0] - old[0]) / held.size, (place[1] - old[1]) / held.size, isSecond);
    if (held.size === 2) pinch(before, [...held.values()], actions);
  });
  element.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      actions.zoom(Math.exp(-WHEEL * event.deltaY), ...placeOf(event));
    },
    { passive: false },
  );
}

/** Zoom by the distance between two fingers. */
function pinch(before, after, actions) {
  const apart = ([one, other]) => Math.hypot(one[0] - other[0], one[1] - other[1]);
  const middle = [0, 1].map((axis) => (after[0][axis] + after[1][axis]) / 2);
  if (apart(before) > 0) actions.zoom(apart(after) / apart(before), middle[0], middle[1]);
}
