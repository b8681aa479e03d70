/**
 * Announce when the state of a printer changes, in whatever section.
 */
import { tell } from "./messages.js";
import { describeState } from "./printer_state.js";
import { known, onChange } from "./status.js";

/** Announce from now on. */
export function announceStates() {
  const states = new Map();
  onChange(() => {
    for (const { name, job } of known.queue?.printers ?? []) {
      const state = describeState(known.queue.jobs.find((one) => one.id === job), known.prints.get(name)?.status);
      const before = states.get(name);
      if (before && before !== state) tell(`${name} is ${state}`);
      states.set(name, state);
    }
  });
}
