/**
 * Decode previews of prints. `printer_slicer/preview/encoding.py` describes the bytes.
 */

/**
 * @typedef {Object} Role
 * @property {string} name
 * @property {string} colour "#rrggbb"
 * @property {boolean} outer whether its moves are external perimeters
 * @property {boolean} priming whether its moves only prepare the nozzle
 */

/**
 * The moves of a print in printing order, and its layers; K moves, L layers.
 *
 * @typedef {Object} Preview
 * @property {string} name
 * @property {number} moves K
 * @property {number[]} origin x, y and z of the points with steps of 0, mm
 * @property {number[]} step mm
 * @property {Uint16Array} points x, y, z of K + 1 points in steps: start of the first move and end of each move
 * @property {Uint16Array} sizes width in 0.005 mm and height in 0.001 mm of each move; 0 for moves without extrusion
 * @property {Uint16Array} speeds 0.1 mm/s
 * @property {Uint8Array} role index into roles
 * @property {Uint8Array} tool
 * @property {Role[]} roles
 * @property {{first: number[], z: number[], height: number[], seconds: number[], command: number[]}} layers
 */

/** Roles before this one are moves without extrusion. */
export const EXTRUSION = 4;
export const JUMP = 0;
export const TRAVEL = 1;
export const RETRACTION = 2;
export const DERETRACTION = 3;

export const WIDTH_STEP = 0.005;
export const HEIGHT_STEP = 0.001;
export const SPEED_STEP = 0.1;

const MAGIC = "PREVIEW1";
const BYTES_PER_MOVE = 14;
const ROWS_PER_TASK = 1 << 16;
const TASK_MS = 12; // after which work pauses, so that the browser can draw and answer
let taskBegin = 0; // ms

/**
 * End the task if it has taken long enough, so that the browser can draw and answer before work goes on.
 *
 * A message ends the task without the 4 ms that browsers add to nested timers.
 *
 * @returns {Promise<void>}
 */
export async function pause() {
  if (performance.now() - taskBegin < TASK_MS) return;
  await new Promise((resume) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resume();
    };
    port2.postMessage(0);
  });
  taskBegin = performance.now();
}

/**
 * Work on many rows in short tasks.
 *
 * @param {number} count
 * @param {(begin: number, end: number) => void} work on rows from `begin` up to, but not including, `end`
 */
export async function workOnRows(count, work) {
  for (let begin = 0; begin < count; begin += ROWS_PER_TASK) {
    work(begin, Math.min(begin + ROWS_PER_TASK, count));
    await pause();
  }
}

/**
 * Decode the bytes of a preview in short tasks.
 *
 * @param {ArrayBuffer} buffer
 * @returns {Promise<Preview>}
 * @throws {Error} if the bytes are not a complete preview
 */
export async function decodePreview(buffer) {
  const bytes = new Uint8Array(buffer);
  const text = new TextDecoder();
  if (bytes.length < 12 || text.decode(bytes.subarray(0, 8)) !== MAGIC) {
    throw new Error("This is not a preview.");
  }
  const begin = 12 + new DataView(buffer).getUint32(8, true);
  const header = JSON.parse(text.decode(bytes.subarray(12, begin)));
  const moves = header.moves;
  if (bytes.length !== begin + BYTES_PER_MOVE * moves) {
    throw new Error("The preview is incomplete.");
  }
  const points = new Uint16Array(3 * (moves + 1));
  const sizes = new Uint16Array(2 * moves);
  const speeds = new Uint16Array(moves);
  points.set(header.start);
  const targets = [
    { values: points, first: 3, stride: 3, start: header.start[0] },
    { values: points, first: 4, stride: 3, start: header.start[1] },
    { values: points, first: 5, stride: 3, start: header.start[2] },
    { values: sizes, first: 0, stride: 2, start: 0 },
    { values: sizes, first: 1, stride: 2, start: 0 },
    { values: speeds, first: 0, stride: 1, start: 0 },
  ];
  for (const [number, target] of targets.entries()) {
    const column = begin + 2 * moves * number;
    await decodeColumn(bytes.subarray(column, column + 2 * moves), target);
  }
  return {
    ...header,
    points,
    sizes,
    speeds,
    role: bytes.slice(begin + 12 * moves, begin + 13 * moves),
    tool: bytes.slice(begin + 13 * moves),
  };
}

/**
 * Add up the differences of a column.
 *
 * @param {Uint8Array} planes low bytes, then high bytes
 * @param {{values: Uint16Array, first: number, stride: number, start: number}} target where the values go
 */
async function decodeColumn(planes, target) {
  const count = planes.length / 2;
  const { values, first, stride, start } = target;
  let value = start;
  await workOnRows(count, (begin, end) => {
    for (let row = begin; row < end; row += 1) {
      const folded = planes[row] | (planes[count + row] << 8);
      value = (value + ((folded >> 1) ^ -(folded & 1))) & 0xffff;
      values[first + stride * row] = value;
    }
  });
}

/**
 * Return x, y or z of a point, mm.
 *
 * @param {Preview} preview
 * @param {number} point index
 * @param {number} axis 0, 1 or 2
 */
export function coordinate(preview, point, axis) {
  return preview.origin[axis] + preview.step[axis] * preview.points[3 * point + axis];
}

/**
 * Return the flow of a move at its requested speed, mm³/s; 0 without extrusion.
 *
 * @param {Preview} preview
 * @param {number} move
 */
export function flowOf(preview, move) {
  const width = WIDTH_STEP * preview.sizes[2 * move];
  const height = HEIGHT_STEP * preview.sizes[2 * move + 1];
  const section =
    width < height ? (Math.PI * width * width) / 4 : (width - height * (1 - Math.PI / 4)) * height;
  return section * SPEED_STEP * preview.speeds[move];
}

/**
 * Return the first move after a layer.
 *
 * @param {Preview} preview
 * @param {number} layer
 */
export function endOfLayer(preview, layer) {
  const { first } = preview.layers;
  return layer + 1 < first.length ? first[layer + 1] : preview.moves;
}

/**
 * Return the box around the print without priming lines: lowest and highest x, y, z, mm.
 *
 * @param {Preview} preview
 * @returns {Promise<{low: number[], high: number[]}>}
 */
export async function boundsOfPrint(preview) {
  const low = [65535, 65535, 65535];
  const high = [0, 0, 0];
  const { points, role, moves } = preview;
  const isPrint = preview.roles.map(({ priming }, number) => number >= EXTRUSION && !priming);
  await workOnRows(moves, (first, last) => {
    for (let move = first; move < last; move += 1) {
      if (!isPrint[role[move]]) continue;
      for (let axis = 0; axis < 3; axis += 1) {
        const begin = points[3 * move + axis];
        const end = points[3 * move + 3 + axis];
        low[axis] = Math.min(low[axis], begin, end);
        high[axis] = Math.max(high[axis], begin, end);
      }
    }
  });
  const toMm = (steps, axis) => preview.origin[axis] + preview.step[axis] * steps;
  return { low: low.map(toMm), high: high.map(toMm) };
}
