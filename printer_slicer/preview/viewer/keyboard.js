/**
 * The keys of the viewer.
 */
import { COLOUR_MODES } from "./colouring.js";

/**
 * @typedef {Object} KeyActions
 * @property {(layers: number) => void} stepLayers
 * @property {(moves: number) => void} stepMoves
 * @property {(factor: number) => void} zoom
 * @property {() => void} fit
 * @property {() => void} play
 * @property {() => void} changeView
 * @property {(mode: string) => void} colour
 */

const ZOOM = 1.25;
const MANY_LAYERS = 10;
const MANY_MOVES = 20;

/**
 * Return the actions of the keys.
 *
 * @param {KeyActions} actions
 * @returns {Record<string, (event: KeyboardEvent) => void>}
 */
function listKeys(actions) {
  const times = (event, many) => (event.shiftKey ? many : 1);
  const keys = {
    ArrowUp: (event) => actions.stepLayers(times(event, MANY_LAYERS)),
    ArrowDown: (event) => actions.stepLayers(-times(event, MANY_LAYERS)),
    ArrowRight: (event) => actions.stepMoves(times(event, MANY_MOVES)),
    ArrowLeft: (event) => actions.stepMoves(-times(event, MANY_MOVES)),
    PageUp: () => actions.stepLayers(MANY_LAYERS),
    PageDown: () => actions.stepLayers(-MANY_LAYERS),
    "+": () => actions.zoom(ZOOM),
    "=": () => actions.zoom(ZOOM),
    "-": () => actions.zoom(1 / ZOOM),
    0: () => actions.fit(),
    " ": () => actions.play(),
    v: () => actions.changeView(),
  };
  COLOUR_MODES.forEach(({ id }, number) => {
    keys[number + 1] = () => actions.colour(id);
  });
  return keys;
}

/**
 * Listen to the keys of a viewer. Controls keep the keys that browsers give them.
 *
 * @param {HTMLElement} element
 * @param {KeyActions} actions
 */
export function listenToKeys(element, actions) {
  const keys = listKeys(actions);
  element.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.altKey || event.metaKey || belongsToControl(event)) return;
    event.preventDefault();
    act(event);
  });
}

/** Whether the control that has the focus uses the key itself. */
function belongsToControl(event) {
  const isArrow = event.key.startsWith("Arrow") || event.key.startsWith("Page");
  const kind = event.target.type ?? "";
  if (kind === "range" || kind === "radio") return isArrow || (kind === "radio" && event.key === " ");
  if (kind.startsWith("select")) return isArrow || event.key === " ";
  if (kind === "checkbox" || kind === "button") return event.key === " ";
  return kind === "text" || event.target.isContentEditable === true;
}
