/**
 * How far a print is: its layer, and the time that is left.
 */

const WINDOW = 120; // s in which the pace is measured
const LEAST = 4; // s of the clock and of the print, after which the measured pace counts

/**
 * @typedef {Object} Progress
 * @property {number} layer index
 * @property {number} share of the layer that is printed
 * @property {number} secondsLeft
 */

/**
 * Return a function that follows a print. Until the pace of the print is known, the speed that is set counts.
 *
 * @returns {(status: any, layers: {seconds: number[], command: number[]}, now: number) => Progress} `now` in s
 */
export function followProgress() {
  let samples = /** @type {{time: number, done: number}[]} */ ([]);
  return (status, { seconds, command }, now) => {
    const { layer, share } = findPlace(status, command);
    const before = seconds.slice(0, layer).reduce((sum, value) => sum + value, 0);
    const done = before + share * seconds[layer];
    const total = seconds.reduce((sum, value) => sum + value, 0);
    const isMoving = status.state === "streaming" && !status.waits_for && layer > 0;
    if (!isMoving || done < (samples.at(-1)?.done ?? 0)) samples = [];
    if (isMoving) samples = [...samples.filter((one) => now - one.time < WINDOW), { time: now, done }];
    return { layer, share, secondsLeft: (total - done) / findPace(samples, status) };
  };
}

/** Return the layer in which a print is, and the share of it that is printed. */
function findPlace({ done = 0, total = 0 }, command) {
  const after = command.findIndex((first) => first > done);
  const layer = Math.max(0, (after < 0 ? command.length : after) - 1);
  const end = command[layer + 1] ?? Math.max(total, command[layer] + 1);
  return { layer, share: Math.max(0, Math.min(1, (done - command[layer]) / (end - command[layer]))) };
}

/** Return how many seconds of the print pass in one second. */
function findPace(samples, status) {
  const time = samples.length ? samples.at(-1).time - samples[0].time : 0;
  const done = samples.length ? samples.at(-1).done - samples[0].done : 0;
  return time >= LEAST && done >= LEAST ? done / time : (status.speed_percent ?? 100) / 100;
}
