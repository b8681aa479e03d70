/**
 * Buttons that send a request: disabled until the answer is there; errors are told.
 */
import { make, setText } from "./elements.js";
import { tellError } from "./messages.js";

const CONFIRM_WITHIN = 5000; // ms

/**
 * Return a button.
 *
 * @param {string} label
 * @param {() => Promise<unknown> | void} act
 * @param {Record<string, any>} [properties] of the element
 */
export function makeButton(label, act, properties = {}) {
  const button = make("button", { type: "button", onclick: () => run(button, act), ...properties }, label);
  return button;
}

/**
 * Return a button that acts only if it is pressed a second time within some seconds.
 *
 * @param {string} label
 * @param {string} question shown after the first press
 * @param {() => Promise<unknown> | void} act
 */
export function makeConfirmedButton(label, question, act) {
  let timer = 0;
  const reset = () => {
    clearTimeout(timer);
    timer = 0;
    setText(button, label);
    button.classList.remove("asks");
  };
  const press = () => {
    if (timer) {
      reset();
      return act();
    }
    timer = setTimeout(reset, CONFIRM_WITHIN);
    setText(button, question);
    button.classList.add("asks");
    return undefined;
  };
  const button = makeButton(label, press, { onblur: () => timer && reset(), "aria-live": "assertive" });
  return button;
}

/**
 * Make a form that sends a request.
 *
 * @param {HTMLFormElement} form
 * @param {() => Promise<unknown>} act
 */
export function submitWith(form, act) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    run(form.querySelector("[type=submit]"), act);
  });
}

/** Carry something out; meanwhile, further presses of its button do nothing. */
async function run(button, act) {
  if (button.getAttribute("aria-disabled") === "true") return;
  button.setAttribute("aria-disabled", "true");
  try {
    await act();
  } catch (error) {
    tellError(error);
  } finally {
    button.removeAttribute("aria-disabled");
  }
}
