/**
 * Make elements of the page.
 */

const ATTRIBUTES = new Set(["class", "for", "role"]);

/**
 * Return a new element.
 *
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Record<string, string | number | boolean | EventListener>} [properties] "class", "for", "role" and names
 *   with "-" are attributes; names with "on" are listeners of events; others are properties of the element
 * @param {(Node | string)[]} children texts are shown as they are
 * @returns {HTMLElementTagNameMap[Tag]}
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (ATTRIBUTES.has(name) || name.includes("-")) element.setAttribute(name, String(value));
    else Object.assign(element, { [name]: value });
  }
  element.append(...children);
  return element;
}

/**
 * Return a slider with a label and its value as text.
 *
 * @param {string} id
 * @param {string} label
 * @param {(value: number) => void} change
 */
export function makeSlider(id, label, change) {
  /** @type {HTMLInputElement} */
  const input = make("input", {
    id,
    type: "range",
    min: "0",
    step: "1",
    oninput: () => change(Number(input.value)),
  });
  const value = make("output", { for: id });
  const row = make("div", { class: "slider" }, make("label", { for: id }, label), value, input);
  return {
    row,
    /** Show a value from 0 to `most`, and the text that tells it. */
    show(number, most, text, isDisabled = false) {
      input.max = String(most);
      input.value = String(number);
      input.disabled = isDisabled;
      input.setAttribute("aria-valuetext", text);
      value.textContent = text;
    },
  };
}

/**
 * Return a box to tick.
 *
 * @param {string} label
 * @param {boolean} checked
 * @param {(checked: boolean) => void} change
 */
export function makeCheckbox(label, checked, change) {
  /** @type {HTMLInputElement} */
  const input = make("input", { type: "checkbox", checked, onchange: () => change(input.checked) });
  return make("label", { class: "choice" }, input, label);
}
