/**
 * Few moves that stand for all: what is drawn while the print turns.
 */
import { EXTRUSION } from "./preview.js";

/**
 * @typedef {Object} CoarseMoves
 * @property {Uint32Array} moves indices of the chosen moves, ascending
 * @property {number} layers every how many layers one is drawn; each ribbon is that many layers high
 */

/**
 * Choose the external perimeters of every n-th layer, so that at most `most` moves are drawn.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {number} most
 * @returns {CoarseMoves}
 */
export function chooseCoarseMoves(preview, most) {
  const { first } = preview.layers;
  const outer = listOuterMoves(preview);
  const starts = [...first, preview.moves].map((move) => lowerIndex(outer, move));
  const top = first.length - 1;
  // The top of the print is always drawn.
  const listLayers = (every) => first.map((_, layer) => layer).filter((layer) => (top - layer) % every === 0);
  const countMoves = (layers) => layers.reduce((sum, layer) => sum + starts[layer + 1] - starts[layer], 0);
  let every = 1;
  while (every <= top && countMoves(listLayers(every)) > most) every += 1;
  const chosen = listLayers(every).map((layer) => outer.subarray(starts[layer], starts[layer + 1]));
  const moves = new Uint32Array(chosen.reduce((sum, part) => sum + part.length, 0));
  let done = 0;
  for (const part of chosen) {
    moves.set(part, done);
    done += part.length;
  }
  return { moves: moves.subarray(0, most), layers: every };
}

/** Return the external perimeters; all extrusions if the file does not name its roles. */
function listOuterMoves(preview) {
  const isNamed = preview.roles.some((role) => role.outer);
  const isOuter = preview.roles.map((role, number) => (isNamed ? role.outer : number >= EXTRUSION));
  const moves = new Uint32Array(preview.moves);
  let count = 0;
  for (let move = 0; move < preview.moves; move += 1) {
    if (!isOuter[preview.role[move]]) continue;
    moves[count] = move;
    count += 1;
  }
  return moves.slice(0, count);
}

/**
 * Return the index of the first value that is not below a number.
 *
 * @param {ArrayLike<number>} values ascending
 * @param {number} number
 */
export function lowerIndex(values, number) {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < number) low = middle + 1;
    else high = middle;
  }
  return low;
}
