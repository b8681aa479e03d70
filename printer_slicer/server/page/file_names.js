/**
 * The endings of the names of models and of G-code; the server writes them into the page.
 */
const LISTS = document.body.dataset;

/** Endings of the names of models, in lower case. */
export const MODEL_SUFFIXES = LISTS.models.split(",");

/** Endings of the names of plain G-code, in lower case. */
export const GCODE_SUFFIXES = LISTS.gcode.split(",");

/** Return whether a name has the ending of a model. @param {string} name */
export function isModel(name) {
  return MODEL_SUFFIXES.some((suffix) => name.toLowerCase().endsWith(suffix));
}
