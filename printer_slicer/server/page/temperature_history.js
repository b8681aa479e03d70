/**
 * Temperatures of the last 24 hours: those before the page was opened come from the server.
 */
import { request } from "./requests.js";

/** Length of the history, s. */
export const HISTORY_LENGTH = 86400;
const RECENT = 1800; // s in which samples are fine
const STEP = 2; // s between samples
const COARSE_STEP = 60; // s between older samples

/**
 * @typedef {Object} Sample
 * @property {number} time s since 1970
 * @property {Record<string, [number, number]>} temperatures actual and target, degrees Celsius, by heater
 */

/** @type {Map<string, Sample[]>} */
const histories = new Map();

/** Return the samples of a printer, the oldest first. @param {string} printer @returns {Sample[]} */
export function getTemperatures(printer) {
  return histories.get(printer) ?? [];
}

/**
 * Add a sample, if the last one is old enough.
 *
 * @param {string} printer
 * @param {Record<string, [number, number]>} temperatures
 * @param {number} time s since 1970
 */
export function addTemperatures(printer, temperatures, time) {
  if (!histories.has(printer)) loadEarlier(printer, time);
  const samples = histories.get(printer) ?? [];
  if (!Object.keys(temperatures).length || time - (samples.at(-1)?.time ?? 0) < STEP) return;
  samples.push({ time, temperatures });
  const isTooMany = samples.length > 2 * (RECENT / STEP + HISTORY_LENGTH / COARSE_STEP);
  if (isTooMany) histories.set(printer, thinOut(samples, time));
}

/** Return one sample a minute of those that are older than half an hour, and none that is too old. */
function thinOut(samples, now) {
  let last = 0;
  return samples.filter(({ time }) => {
    const isKept = now - time <= HISTORY_LENGTH && (now - time <= RECENT || time - last >= COARSE_STEP);
    if (isKept) last = time;
    return isKept;
  });
}

/** Ask the server for the samples before a time. */
async function loadEarlier(printer, time) {
  histories.set(printer, []);
  try {
    const earlier = await request("GET", `/v1/printers/${encodeURIComponent(printer)}/temperatures`);
    histories.get(printer).unshift(...earlier.filter((sample) => sample.time < time));
  } catch {
    // The chart begins with the page.
  }
}

/** Return the name of a heater for people. @param {string} heater as firmware reports it */
export function nameHeater(heater) {
  if (heater === "B") return "Bed";
  if (heater === "C") return "Chamber";
  return heater === "T" ? "Nozzle" : `Nozzle ${heater.slice(1)}`;
}
