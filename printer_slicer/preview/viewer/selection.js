/**
 * What the viewer shows: the layers, the last move, the colours, and what is drawn beside extrusions.
 */
import { endOfLayer } from "./preview.js";

/**
 * @typedef {Object} Selection
 * @property {"layer" | "solid"} view one layer from above, or all layers in 3D
 * @property {number} bottom lowest layer in 3D
 * @property {number} layer highest layer; the one that is shown from above
 * @property {number} shown number of moves of that layer that are shown
 * @property {string} mode an id of `COLOUR_MODES`
 * @property {boolean} travels
 * @property {boolean} retractions
 * @property {boolean} seams
 */

/**
 * Return what is shown first: the middle layer, where most parts have walls and infill.
 *
 * @param {import("./preview.js").Preview} preview
 * @returns {Selection}
 */
export function firstSelection(preview) {
  const layer = Math.floor((preview.layers.first.length - 1) / 2);
  const shown = movesOfLayer(preview, layer);
  return { view: "layer", bottom: 0, layer, shown, mode: "role", travels: false, retractions: false, seams: false };
}

/**
 * Return the selection with changes, within the limits of the print. A change of the layer shows all its moves.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {Selection} selection
 * @param {Partial<Selection>} change
 * @returns {Selection}
 */
export function changeSelection(preview, selection, change) {
  const next = { ...selection, ...change };
  const top = preview.layers.first.length - 1;
  next.layer = limit(next.layer, 0, top);
  next.bottom = limit(next.bottom, 0, top);
  if (next.bottom > next.layer) {
    if ("bottom" in change) next.layer = next.bottom;
    else next.bottom = next.layer;
  }
  const most = movesOfLayer(preview, next.layer);
  next.shown = next.layer !== selection.layer && !("shown" in change) ? most : limit(next.shown, 1, most);
  return next;
}

/**
 * Return the selection one or more moves further or back, over the borders of layers.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {Selection} selection
 * @param {number} moves
 * @returns {Partial<Selection>} a change
 */
export function stepMoves(preview, selection, moves) {
  const shown = selection.shown + moves;
  if (shown < 1 && selection.layer > 0) {
    return { layer: selection.layer - 1, shown: movesOfLayer(preview, selection.layer - 1) };
  }
  const most = movesOfLayer(preview, selection.layer);
  if (shown > most && selection.layer + 1 < preview.layers.first.length) {
    return { layer: selection.layer + 1, shown: 1 };
  }
  return { shown };
}

/** Return the number of moves of a layer. */
export function movesOfLayer(preview, layer) {
  return endOfLayer(preview, layer) - preview.layers.first[layer];
}

function limit(value, least, most) {
  return Math.max(least, Math.min(Math.round(value), most));
}
