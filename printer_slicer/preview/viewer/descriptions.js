/**
 * Texts about moves, layers and times.
 */
import { formatValue } from "./colouring.js";
import { EXTRUSION, HEIGHT_STEP, SPEED_STEP, WIDTH_STEP, coordinate, flowOf } from "./preview.js";

/**
 * Return what is known about a move.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {number} move
 */
export function describeMove(preview, move) {
  const [x, y, z] = [2, 2, 3].map((digits, axis) => Number(coordinate(preview, move + 1, axis).toFixed(digits)));
  const parts = [preview.roles[preview.role[move]].name, `X ${x} Y ${y} Z ${z}`];
  if (preview.role[move] >= EXTRUSION) {
    parts.push(
      `width ${formatValue(WIDTH_STEP * preview.sizes[2 * move])} mm`,
      `height ${formatValue(HEIGHT_STEP * preview.sizes[2 * move + 1])} mm`,
      `flow ${formatValue(flowOf(preview, move))} mm³/s`,
    );
  }
  parts.push(`speed ${formatValue(SPEED_STEP * preview.speeds[move])} mm/s`, `tool ${preview.tool[move]}`);
  return parts.join(", ");
}

/**
 * Return the number and z of a layer.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {number} layer
 */
export function describeLayer(preview, layer) {
  const { first, z } = preview.layers;
  return `${layer + 1} of ${first.length}, Z ${Number(z[layer].toFixed(3))} mm`;
}

/**
 * Return the size of the print.
 *
 * @param {import("./preview.js").Preview} preview
 */
export function describePrint(preview) {
  const seconds = preview.layers.seconds.reduce((sum, one) => sum + one, 0);
  const layers = preview.layers.first.length;
  return `${layers} layers, ${preview.moves.toLocaleString("en")} moves, ${formatDuration(seconds)} of motion`;
}

/**
 * Return a time in hours and minutes, or in seconds if it is short.
 *
 * @param {number} seconds
 */
export function formatDuration(seconds) {
  if (seconds < 60) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}
