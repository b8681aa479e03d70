/**
 * The colours of moves: by role, speed, height, width, flow or tool.
 */
import { EXTRUSION, HEIGHT_STEP, SPEED_STEP, WIDTH_STEP, flowOf } from "./preview.js";

/**
 * @typedef {Object} Colouring
 * @property {Uint8Array} index of each move: its colour in `palette`
 * @property {string[]} palette "#rrggbb"; the first ones are those of the moves without extrusion
 * @property {{label: string, colour: string}[]} legend
 * @property {string} unit
 */

/** The ways to colour moves, in the order of their keys. */
export const COLOUR_MODES = [
  { id: "role", label: "Role", unit: "" },
  { id: "speed", label: "Speed", unit: "mm/s" },
  { id: "height", label: "Height", unit: "mm" },
  { id: "width", label: "Width", unit: "mm" },
  { id: "flow", label: "Flow", unit: "mm³/s" },
  { id: "tool", label: "Tool", unit: "" },
];

/** Viridis (van der Walt and Smith, 2015; CC0) without its darkest part. */
const SCALE = [
  "#472d7b", "#424086", "#3b528b", "#33638d", "#2c728e", "#26828e", "#21918c", "#1f9f88",
  "#27ad81", "#3dbc74", "#5cc863", "#81d34d", "#aadc32", "#d5e21a", "#fde725",
];
/** Okabe and Ito, "Color universal design", 2008. */
const TOOLS = ["#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#999999"];
const OUTLIERS = 0.002; // fraction of the extrusions at each end of the scale, so that a few do not stretch it
const BINS = 4096;
const MOST_LABELS = 7;

/**
 * Return the colours of all moves.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {string} mode an id of `COLOUR_MODES`
 * @returns {Colouring}
 */
export function colourMoves(preview, mode) {
  if (mode === "role") return colourByRole(preview);
  if (mode === "tool") return colourByTool(preview);
  const { unit } = COLOUR_MODES.find((one) => one.id === mode);
  return colourByValue(preview, valueReader(preview, mode), unit);
}

/**
 * Return a function that returns the value of a move, in the unit of the mode.
 *
 * @returns {(move: number) => number}
 */
function valueReader(preview, mode) {
  const { speeds, sizes } = preview;
  if (mode === "speed") return (move) => SPEED_STEP * speeds[move];
  if (mode === "height") return (move) => HEIGHT_STEP * sizes[2 * move + 1];
  if (mode === "width") return (move) => WIDTH_STEP * sizes[2 * move];
  return (move) => flowOf(preview, move);
}

function colourByRole(preview) {
  const used = new Set();
  for (const role of preview.role) used.add(role);
  const legend = preview.roles
    .map((role, number) => ({ label: role.name, colour: role.colour, number }))
    .filter((entry) => entry.number >= EXTRUSION && used.has(entry.number));
  return { index: preview.role, palette: preview.roles.map((role) => role.colour), legend, unit: "" };
}

function colourByTool(preview) {
  const index = new Uint8Array(preview.moves);
  const used = new Set();
  for (let move = 0; move < preview.moves; move += 1) {
    const isExtrusion = preview.role[move] >= EXTRUSION;
    index[move] = isExtrusion ? EXTRUSION + (preview.tool[move] % TOOLS.length) : preview.role[move];
    if (isExtrusion) used.add(preview.tool[move]);
  }
  const legend = [...used]
    .sort((one, other) => one - other)
    .map((tool) => ({ label: `Tool ${tool}`, colour: TOOLS[tool % TOOLS.length] }));
  return { index, palette: [...basePalette(preview), ...TOOLS], legend, unit: "" };
}

function colourByValue(preview, valueOf, unit) {
  const [low, high] = findRange(preview, valueOf);
  const perValue = high > low ? SCALE.length / (high - low) : 0;
  const index = new Uint8Array(preview.moves);
  for (let move = 0; move < preview.moves; move += 1) {
    const role = preview.role[move];
    const place = Math.floor((valueOf(move) - low) * perValue);
    index[move] = role < EXTRUSION ? role : EXTRUSION + Math.max(0, Math.min(place, SCALE.length - 1));
  }
  return { index, palette: [...basePalette(preview), ...SCALE], legend: scaleLegend(low, high), unit };
}

function basePalette(preview) {
  return preview.roles.slice(0, EXTRUSION).map((role) => role.colour);
}

/**
 * Return the range of values of extrusions without outliers.
 *
 * @returns {[number, number]}
 */
function findRange(preview, valueOf) {
  let low = Infinity;
  let high = -Infinity;
  let count = 0;
  for (let move = 0; move < preview.moves; move += 1) {
    if (preview.role[move] < EXTRUSION) continue;
    const value = valueOf(move);
    low = Math.min(low, value);
    high = Math.max(high, value);
    count += 1;
  }
  if (!(high > low)) return [count ? low : 0, count ? low : 0];
  const bins = new Uint32Array(BINS + 1);
  for (let move = 0; move < preview.moves; move += 1) {
    if (preview.role[move] >= EXTRUSION) bins[Math.floor(((valueOf(move) - low) / (high - low)) * BINS)] += 1;
  }
  const inBins = (bin) => low + (bin / BINS) * (high - low);
  const first = skipBins(bins, OUTLIERS * count);
  const last = BINS - skipBins(bins.reverse(), OUTLIERS * count);
  return last > first ? [inBins(first), inBins(last)] : [low, high];
}

/** Return the first bin after those that hold fewer than `count` values together. */
function skipBins(bins, count) {
  let sum = 0;
  let bin = 0;
  while (bin < BINS && sum + bins[bin] <= count) {
    sum += bins[bin];
    bin += 1;
  }
  return bin;
}

function scaleLegend(low, high) {
  if (!(high > low)) return [{ label: formatValue(low), colour: SCALE[0] }];
  return Array.from({ length: MOST_LABELS }, (_, number) => {
    const share = number / (MOST_LABELS - 1);
    const colour = SCALE[Math.round(share * (SCALE.length - 1))];
    return { label: formatValue(low + share * (high - low)), colour };
  }).reverse();
}

/**
 * Return a value with three significant figures.
 *
 * @param {number} value
 */
export function formatValue(value) {
  return value === 0 ? "0" : String(Number(value.toPrecision(3)));
}
