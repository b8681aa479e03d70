/**
 * Emergency stops of all printers that print: always on the screen, and without a question.
 */
import { makeButton } from "./buttons.js";
import { make, makeList, setShown } from "./elements.js";
import { tell } from "./messages.js";
import { sendCommand } from "./printer_console.js";
import { allows, known } from "./status.js";

/** Return the bar with the emergency stops. */
export function makeEmergencyStops() {
  const list = make("ul", { class: "row plain" });
  const element = make("aside", { class: "emergency", "aria-label": "Emergency stop" }, list);
  const showStops = makeList(list, (name) => name, makeStop);
  return {
    element,
    show() {
      const names = [...known.prints.keys()].filter((name) => allows("control", name)).sort();
      setShown(element, names.length > 0);
      showStops(names);
    },
  };
}

/** Return the emergency stop of a printer. */
function makeStop(name) {
  const stop = async () => {
    await sendCommand(name, "abort");
    tell(`Emergency stop of ${name} is sent`);
  };
  const button = makeButton(`Emergency stop: ${name}`, stop, { class: "stop" });
  return { element: make("li", {}, button), show: () => {} };
}
