/**
 * Draw one layer from above on a canvas.
 */
import { EXTRUSION, JUMP, RETRACTION, TRAVEL, WIDTH_STEP, endOfLayer } from "./preview.js";

/**
 * @typedef {Object} LayerPicture what to draw
 * @property {number} layer
 * @property {number} end first move that is not drawn
 * @property {import("./colouring.js").Colouring} colouring
 * @property {boolean} travels
 * @property {boolean} retractions
 * @property {boolean} seams
 * @property {{faint: string, seam: string, rest?: string}} ink colours of the page; `rest` is that of the moves of the
 *   layer after `end`, which are not drawn without it
 */

const INNER = 0.8; // fraction of the width between the dark edges, by which neighbours are told apart
const EDGE = 0.6; // brightness of the edges
const MIN_WIDTH_WITH_EDGES = 3; // px
const SAME_WIDTH = 2; // in the unit of the column; nearly equal widths are one stroke
const MAX_SEGMENTS = 300; // of one stroke: long ones take more than their share of time
const MARK = 3.5; // px, radius
const MIN_WIDTH = 0.7; // px
const TRAVEL_WIDTH = 1; // px

/** @type {Map<string, string>} */
const darkColours = new Map();

/**
 * Draw a layer, with the layer below it in a faint colour.
 *
 * @param {CanvasRenderingContext2D} context of a canvas whose transformation is px of the page
 * @param {import("./preview.js").Preview} preview
 * @param {import("./flat_window.js").FlatWindow} view
 * @param {LayerPicture} picture
 */
export function drawLayer(context, preview, view, picture) {
  context.clearRect(0, 0, view.width, view.height);
  context.lineCap = "round";
  context.lineJoin = "round";
  const pen = makePen(context, preview, view);
  const { first } = preview.layers;
  const { layer, end, colouring } = picture;
  if (layer > 0) {
    drawExtrusions(pen, preview, first[layer - 1], endOfLayer(preview, layer - 1), () => picture.ink.faint, false);
  }
  const { index, palette } = colouring;
  if (picture.ink.rest) drawExtrusions(pen, preview, end, endOfLayer(preview, layer), () => picture.ink.rest, false);
  drawExtrusions(pen, preview, first[layer], end, (move) => palette[index[move]], true);
  if (picture.travels) drawTravels(pen, preview, first[layer], end);
  if (picture.retractions) drawMarks(pen, preview, listRetractions(preview, first[layer], end));
  if (picture.seams) {
    const seams = listSeams(preview, first[layer], end).map((move) => ({ point: move, colour: picture.ink.seam }));
    drawMarks(pen, preview, seams);
  }
}

/** Return the context, and functions that convert a point of the preview to px. */
function makePen(context, preview, view) {
  const { points, origin, step } = preview;
  const left = view.width / 2 + (origin[0] - view.x) * view.scale;
  const top = view.height / 2 - (origin[1] - view.y) * view.scale;
  return {
    context,
    scale: view.scale,
    x: (point) => left + step[0] * view.scale * points[3 * point],
    y: (point) => top - step[1] * view.scale * points[3 * point + 1],
  };
}

/**
 * Draw extrusions in printing order, so that later ones cover earlier ones.
 *
 * @param {(move: number) => string} colourOf
 * @param {boolean} edges whether each path has dark edges where there is room
 */
function drawExtrusions(pen, preview, begin, end, colourOf, edges) {
  const { role } = preview;
  let first = begin;
  while (first < end) {
    if (role[first] < EXTRUSION) {
      first += 1;
      continue;
    }
    let last = first + 1;
    while (last < end && role[last] === role[first]) last += 1;
    const hasEdges = edges && WIDTH_STEP * preview.sizes[2 * first] * pen.scale >= MIN_WIDTH_WITH_EDGES;
    if (hasEdges) drawPath(pen, preview, first, last, 1, (move) => darken(colourOf(move)));
    drawPath(pen, preview, first, last, hasEdges ? INNER : 1, colourOf);
    first = last;
  }
}

/**
 * Draw consecutive extrusions, as few strokes as their widths and colours allow.
 *
 * @param {number} share of the width that is drawn
 * @param {(move: number) => string} colourOf
 */
function drawPath(pen, preview, begin, end, share, colourOf) {
  const { context } = pen;
  let colour = "";
  let width = -1;
  let segments = 0;
  for (let move = begin; move < end; move += 1) {
    const newColour = colourOf(move);
    const newWidth = preview.sizes[2 * move];
    if (newColour !== colour || Math.abs(newWidth - width) > SAME_WIDTH || segments >= MAX_SEGMENTS) {
      if (segments) context.stroke();
      segments = 0;
      colour = newColour;
      width = newWidth;
      context.beginPath();
      context.strokeStyle = colour;
      context.lineWidth = Math.max(share * WIDTH_STEP * width * pen.scale, MIN_WIDTH);
      context.moveTo(pen.x(move), pen.y(move));
    }
    context.lineTo(pen.x(move + 1), pen.y(move + 1));
    segments += 1;
  }
  if (segments) context.stroke();
}

/** Return half as bright a colour. */
function darken(colour) {
  if (!darkColours.has(colour)) {
    const parts = [1, 3, 5].map((place) => Math.round(Number.parseInt(colour.slice(place, place + 2), 16) * EDGE));
    darkColours.set(colour, `rgb(${parts.join(" ")})`);
  }
  return darkColours.get(colour);
}

function drawTravels(pen, preview, begin, end) {
  const { context } = pen;
  context.beginPath();
  context.strokeStyle = preview.roles[TRAVEL].colour;
  context.lineWidth = TRAVEL_WIDTH;
  for (let move = begin; move < end; move += 1) {
    if (preview.role[move] !== TRAVEL) continue;
    context.moveTo(pen.x(move), pen.y(move));
    context.lineTo(pen.x(move + 1), pen.y(move + 1));
  }
  context.setLineDash([4, 3]);
  context.stroke();
  context.setLineDash([]);
}

function drawMarks(pen, preview, marks) {
  const { context } = pen;
  for (const { point, colour } of marks) {
    context.beginPath();
    context.fillStyle = colour;
    context.arc(pen.x(point), pen.y(point), MARK, 0, 2 * Math.PI);
    context.fill();
  }
}

function listRetractions(preview, begin, end) {
  const marks = [];
  for (let move = begin; move < end; move += 1) {
    const role = preview.role[move];
    if (role >= RETRACTION && role < EXTRUSION) marks.push({ point: move, colour: preview.roles[role].colour });
  }
  return marks;
}

/**
 * Return the moves that begin an external perimeter.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {number} begin first move
 * @param {number} end first move that does not count
 * @returns {number[]}
 */
export function listSeams(preview, begin, end) {
  const seams = [];
  let wasOuter = false;
  for (let move = begin; move < end; move += 1) {
    const role = preview.role[move];
    const isOuter = preview.roles[role].outer;
    if (isOuter && !wasOuter) seams.push(move);
    wasOuter = isOuter;
  }
  return seams;
}

/**
 * Return the move of a layer that is nearest to a place, or -1 if none is within reach.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {{layer: number, end: number, travels: boolean}} picture
 * @param {number[]} place x and y, mm
 * @param {number} reach mm
 */
export function findMove(preview, picture, [x, y], reach) {
  let best = -1;
  let least = reach;
  const { points, origin, step } = preview;
  for (let move = preview.layers.first[picture.layer]; move < picture.end; move += 1) {
    const role = preview.role[move];
    if (role === JUMP || (role < EXTRUSION && !(picture.travels && role === TRAVEL))) continue;
    const at = 3 * move;
    const beginX = origin[0] + step[0] * points[at] - x;
    const beginY = origin[1] + step[1] * points[at + 1] - y;
    const wayX = step[0] * (points[at + 3] - points[at]);
    const wayY = step[1] * (points[at + 4] - points[at + 1]);
    const squared = wayX * wayX + wayY * wayY;
    const share = squared ? Math.max(0, Math.min(1, -(beginX * wayX + beginY * wayY) / squared)) : 0;
    const half = role < EXTRUSION ? 0 : (WIDTH_STEP * preview.sizes[2 * move]) / 2;
    const distance = Math.hypot(beginX + share * wayX, beginY + share * wayY) - half;
    // The last of several moves at one place covers the others.
    if (distance <= Math.max(least, 0)) {
      least = distance;
      best = move;
    }
  }
  return best;
}
