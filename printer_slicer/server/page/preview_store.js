/**
 * Previews and layers of files; the last ones are kept.
 */
import { boundsOfPrint, decodePreview } from "./preview.js";
import { RequestError, request } from "./requests.js";

const MAX_PREVIEWS = 3;
const MAX_TABLES = 20;

const previews = new Map();
const tables = new Map();

/**
 * Return the preview of a file.
 *
 * @param {string} file
 * @returns {Promise<{preview: import("./preview.js").Preview, bounds: {low: number[], high: number[]}}>}
 * @throws {RequestError}
 */
export function loadPreview(file) {
  return keep(previews, MAX_PREVIEWS, file, () => fetchPreview(file));
}

/**
 * Return the columns of the layers of a file.
 *
 * @param {string} file
 * @returns {Promise<{z: number[], seconds: number[], command: number[]}>}
 * @throws {RequestError}
 */
export function loadLayers(file) {
  return keep(tables, MAX_TABLES, file, () => request("GET", `/v1/files/${file}/layers`));
}

/** Return the value of a key; values that cannot be loaded are not kept, nor the oldest ones. */
function keep(values, most, key, load) {
  if (!values.has(key)) {
    const value = load();
    values.set(key, value);
    value.catch(() => values.delete(key));
    if (values.size > most) values.delete(values.keys().next().value);
  }
  return values.get(key);
}

async function fetchPreview(file) {
  const answer = await fetch(`/v1/files/${file}/preview`).catch(() => null);
  if (!answer?.ok) throw new RequestError(answer?.status ?? 0, "The layers cannot be loaded");
  const preview = await decodePreview(await answer.arrayBuffer());
  return { preview, bounds: await boundsOfPrint(preview) };
}
