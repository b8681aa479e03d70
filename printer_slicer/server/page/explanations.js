/**
 * Why each job waits: asked again when the queue has changed.
 */
import { request } from "./requests.js";
import { known } from "./status.js";

let explanations = /** @type {any[]} */ ([]);
let revision = -1;

/** Return the explanation of a job, undefined if none is known. @param {number} job */
export function findExplanation(job) {
  return explanations.find((one) => one.job.id === job);
}

/** Return the first ready job that a printer could print, undefined if there is none. @param {string} printer */
export function findNextJob(printer) {
  const fits = (one) => one.printers.some((match) => match.printer === printer && match.fits);
  return explanations.find((one) => one.job.state === "ready" && fits(one))?.job;
}

/** Ask the server if the queue has changed, and then call a function. @param {() => void} show */
export async function updateExplanations(show) {
  if (!known.queue || revision === known.queue.revision) return;
  revision = known.queue.revision;
  try {
    explanations = await request("GET", "/v1/explanations");
    show();
  } catch {
    revision = -1; // the next change of the status asks again
  }
}
