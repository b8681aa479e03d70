/**
 * Temperatures of the last 30 minutes, in the memory of the page.
 */

/** Length of the history, s. */
export const HISTORY_LENGTH = 1800;
const STEP = 2; // s between samples

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
  const samples = histories.get(printer) ?? [];
  if (!Object.keys(temperatures).length || time - (samples.at(-1)?.time ?? 0) < STEP) return;
  samples.push({ time, temperatures });
  histories.set(
    printer,
    samples.filter((sample) => time - sample.time <= HISTORY_LENGTH),
  );
}

/** Return the name of a heater for people. @param {string} heater as firmware reports it */
export function nameHeater(heater) {
  if (heater === "B") return "Bed";
  if (heater === "C") return "Chamber";
  return heater === "T" ? "Nozzle" : `Nozzle ${heater.slice(1)}`;
}
