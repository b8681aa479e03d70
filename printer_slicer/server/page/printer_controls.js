/**
 * Control of a running print: pause, cancel, speed, flow, temperatures, objects, and the printer's prompts.
 */
import { makeButton, makeConfirmedButton, submitWith } from "./buttons.js";
import { make, makeField, makeList, setShown, setText } from "./elements.js";
import { tell } from "./messages.js";

const DIALS = [
  { word: "speed", label: "Speed, %", min: 10, max: 300, step: 1 },
  { word: "flow", label: "Flow, %", min: 50, max: 150, step: 1 },
  { word: "nozzle", label: "Nozzle, °C", min: 0, max: 300, step: 1 },
  { word: "bed", label: "Bed, °C", min: 0, max: 120, step: 1 },
  { word: "fan", label: "Fan, %", min: 0, max: 100, step: 1 },
];
const BABY_STEPS = [-0.05, -0.01, 0.01, 0.05]; // mm

/**
 * Return the controls of the print on a printer.
 *
 * @param {(command: string) => Promise<any>} send
 * @returns {{element: HTMLElement, show: (status: any) => void}}
 */
export function makeControls(send) {
  const sendAndTell = async (command) => tell((await send(command))?.answer || `Sent: ${command}`);
  const pause = makeButton("Pause", () => sendAndTell("pause"));
  const pauseNow = makeButton("Pause now", () => sendAndTell("pause now"));
  const resume = makeButton("Resume", () => sendAndTell("resume"), { class: "main" });
  const cancel = makeConfirmedButton("Cancel", "Press again to cancel", () => sendAndTell("cancel"));
  const prompt = makePrompt(sendAndTell);
  const objects = makeObjects(sendAndTell);
  const dials = DIALS.map((dial) => makeDial(dial, sendAndTell));
  const adjust = make(
    "details",
    {},
    make("summary", {}, "Adjust"),
    make("div", { class: "dials" }, ...dials.map((dial) => dial.element)),
    makeBabySteps(sendAndTell),
    objects.element,
  );
  const buttons = make("div", { class: "row" }, pause, pauseNow, resume, cancel);
  return {
    element: make("div", { class: "controls" }, prompt.element, buttons, adjust),
    show(status) {
      const isPaused = status.state === "paused";
      setShown(pause, !isPaused);
      setShown(pauseNow, !isPaused);
      setShown(resume, isPaused);
      prompt.show(status.prompt);
      objects.show(status.objects ?? [], status.cancelled ?? []);
      for (const dial of dials) dial.show(status);
    },
  };
}

/** Return a field with a number that is sent with a word. */
function makeDial({ word, label, min, max, step }, send) {
  const input = make("input", { type: "number", required: true, min, max, step, inputMode: "numeric" });
  const set = make("button", { type: "submit", "aria-label": `Set ${label}` }, "Set");
  const form = make("form", { class: "row" }, makeField(label, input), set);
  submitWith(form, () => send(`${word} ${input.value}`));
  const readValue = (status) => {
    if (word === "nozzle") return status.temperatures?.T?.[1];
    if (word === "bed") return status.temperatures?.B?.[1];
    return status[`${word}_percent`];
  };
  let shown = "";
  return {
    element: form,
    /** Show the present value, unless the user has typed another one. */
    show(status) {
      const value = readValue(status);
      if (value !== undefined && input.value === String(Math.round(value))) shown = input.value;
      const isTyped = input.value !== shown || document.activeElement === input;
      if (value === undefined || isTyped) return;
      shown = String(Math.round(value));
      input.value = shown;
    },
  };
}

/** Return buttons that move the nozzle up or down a little. */
function makeBabySteps(send) {
  const buttons = BABY_STEPS.map((step) => {
    const text = `${step > 0 ? "+" : "−"}${Math.abs(step).toFixed(2)}`;
    const label = `${step > 0 ? "Raise" : "Lower"} the nozzle by ${Math.abs(step)} mm`;
    return makeButton(text, () => send(`babystep ${step}`), { "aria-label": label });
  });
  return make("fieldset", {}, make("legend", {}, "Baby steps, mm"), make("div", { class: "row" }, ...buttons));
}

/** Return the objects of the plate, each with a button that cancels it. */
function makeObjects(send) {
  const list = make("ul", { class: "plain" });
  const element = make("fieldset", {}, make("legend", {}, "Objects"), list);
  let cancelled = /** @type {string[]} */ ([]);
  const showObjects = makeList(
    list,
    (name) => name,
    (name) => {
      const button = makeConfirmedButton("Cancel object", "Press again to cancel", () => send(`object ${name}`));
      const state = make("span", { class: "hint" }, "cancelled");
      return {
        element: make("li", { class: "row" }, make("span", { class: "grow" }, name), state, button),
        show() {
          setShown(button, !cancelled.includes(name));
          setShown(state, cancelled.includes(name));
        },
      };
    },
  );
  return {
    element,
    show(objects, cancelledNow) {
      cancelled = cancelledNow;
      setShown(element, objects.length > 0);
      showObjects(objects);
    },
  };
}

/** Return the prompt of the printer, with its buttons. */
function makePrompt(send) {
  const text = make("p", {});
  const row = make("div", { class: "row" });
  const element = make("div", { class: "prompt", role: "group", "aria-label": "The printer asks", hidden: true }, text, row);
  let shown = "";
  return {
    element,
    show(prompt) {
      setShown(element, Boolean(prompt));
      const key = JSON.stringify(prompt);
      if (!prompt || key === shown) return;
      shown = key;
      setText(text, prompt.text);
      row.replaceChildren(...prompt.buttons.map((label, number) => makeButton(label, () => send(`answer ${number}`))));
    },
  };
}
