/**
 * The state of a printer in words.
 */
const STATE_TEXTS = { streaming: "printing", identifying: "connecting" };

/** Return the state of a printer as a word. @param {any} job undefined if it prints none @param {any} status of the print */
export function describeState(job, status) {
  if (!job) return "idle";
  if (!status) return job.state;
  return STATE_TEXTS[status.state] ?? status.state;
}
