/**
 * The colours of moves: by role, speed, height, width, flow or tool.
 */
import { EXTRUSION, HEIGHT_STEP, SPEED_STEP, WIDTH_STEP, flowOf, workOnRows } from "./preview.js";

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
const TOOL_NUMBERS = Array.from({ length: 256 }, (_, number) => number);
const OUTLIERS = 0.002; // fraction of the extrusions at each end of the scale, so that a few do not stretch it
const BINS = 4096;
const MAX_LABELS = 7;

/**
 * Return the colours of all moves; the work is done in short tasks.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {string} mode an id of `COLOUR_MODES`
 * @returns {Promise<Colouring>}
 */
export async function colourMoves(preview, mode) {
  if (mode === "role") return colourByRole(preview);
  if (mode === "tool") return colourByTool(preview);
  const { unit } = COLOUR_MODES.find((one) => one.id === mode);
  return colourByValue(preview, await listValues(preview, mode), unit);
}

/**
 * Return the value of each move in the unit of a mode.
 *
 * @returns {Promise<Float32Array>}
 */
async function listValues(preview, mode) {
  const { speeds, sizes } = preview;
  const readers = {
    speed: (move) => SPEED_STEP * speeds[move],
    height: (move) => HEIGHT_STEP * sizes[2 * move + 1],
    width: (move) => WIDTH_STEP * sizes[2 * move],
    flow: (move) => flowOf(preview, move),
  };
  const valueOf = readers[mode];
  const values = new Float32Array(preview.moves);
  await workOnRows(preview.moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) values[move] = valueOf(move);
  });
  return values;
}

async function colourByRole(preview) {
  const used = await findUsed(preview, preview.role);
  const legend = preview.roles
    .map((role, number) => ({ label: role.name, colour: role.colour, number }))
    .filter((entry) => entry.number >= EXTRUSION && used[entry.number]);
  return { index: preview.role, palette: preview.roles.map((role) => role.colour), legend, unit: "" };
}

async function colourByTool(preview) {
  const { role, tool } = preview;
  const used = await findUsed(preview, tool);
  const index = new Uint8Array(preview.moves);
  await workOnRows(preview.moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) {
      index[move] = role[move] >= EXTRUSION ? EXTRUSION + (tool[move] % TOOLS.length) : role[move];
    }
  });
  const legend = TOOL_NUMBERS.filter((number) => used[number]).map((number) => ({
    label: `Tool ${number}`,
    colour: TOOLS[number % TOOLS.length],
  }));
  return { index, palette: [...basePalette(preview), ...TOOLS], legend, unit: "" };
}

/**
 * Return which values of a column extrusions have.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {Uint8Array} column
 * @returns {Promise<Uint8Array>} 256 flags
 */
async function findUsed(preview, column) {
  const used = new Uint8Array(256);
  await workOnRows(preview.moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) {
      if (preview.role[move] >= EXTRUSION) used[column[move]] = 1;
    }
  });
  return used;
}

async function colourByValue(preview, values, unit) {
  const [low, high] = await findRange(preview, values);
  const perValue = high > low ? SCALE.length / (high - low) : 0;
  const index = new Uint8Array(preview.moves);
  await workOnRows(preview.moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) {
      const role = preview.role[move];
      const place = Math.floor((values[move] - low) * perValue);
      index[move] = role < EXTRUSION ? role : EXTRUSION + Math.max(0, Math.min(place, SCALE.length - 1));
    }
  });
  return { index, palette: [...basePalette(preview), ...SCALE], legend: scaleLegend(low, high), unit };
}

function basePalette(preview) {
  return preview.roles.slice(0, EXTRUSION).map((role) => role.colour);
}

/**
 * Return the range of values of extrusions without outliers.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {Float32Array} values
 * @returns {Promise<[number, number]>}
 */
async function findRange(preview, values) {
  let low = Infinity;
  let high = -Infinity;
  let count = 0;
  const { role, moves } = preview;
  await workOnRows(moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) {
      if (role[move] < EXTRUSION) continue;
      low = Math.min(low, values[move]);
      high = Math.max(high, values[move]);
      count += 1;
    }
  });
  if (!(high > low)) return [count ? low : 0, count ? low : 0];
  const bins = new Uint32Array(BINS + 1);
  await workOnRows(moves, (begin, end) => {
    for (let move = begin; move < end; move += 1) {
      if (role[move] >= EXTRUSION) bins[Math.floor(((values[move] - low) / (high - low)) * BINS)] += 1;
    }
  });
  const valueAt = (bin) => low + (bin / BINS) * (high - low);
  const first = skipBins(bins, OUTLIERS * count);
  const last = BINS - skipBins(bins.reverse(), OUTLIERS * count);
  return last > first ? [valueAt(first), valueAt(last)] : [low, high];
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
  return Array.from({ length: MAX_LABELS }, (_, number) => {
    const share = number / (MAX_LABELS - 1);
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
