/**
 * Few moves that stand for all: what is drawn while the print turns.
 */

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
  let layers = Math.max(1, Math.ceil(outer.length / most));
  for (;;) {
    const chosen = outer.filter((move) => isInChosenLayer(first, move, layers));
    if (chosen.length <= most || layers >= first.length) {
      return { moves: chosen.length <= most ? chosen : chosen.subarray(0, most), layers };
    }
    layers += 1;
  }
}

/** Return the external perimeters; all extrusions if the file does not name its roles. */
function listOuterMoves(preview) {
  const isOuter = preview.roles.map((role) => role.outer);
  const isNamed = preview.role.some((role) => isOuter[role]);
  const moves = new Uint32Array(preview.moves);
  let count = 0;
  for (let move = 0; move < preview.moves; move += 1) {
    const role = preview.role[move];
    if (isNamed ? isOuter[role] : role >= 4) {
      moves[count] = move;
      count += 1;
    }
  }
  return moves.slice(0, count);
}

function isInChosenLayer(first, move, layers) {
  const layer = lowerIndex(first, move + 1) - 1;
  // The top of the print is always drawn.
  return (first.length - 1 - layer) % layers === 0;
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
