/**
 * Make elements of the page, and change them only where something has changed, so that the focus stays where it is.
 */

/**
 * Return a new element.
 *
 * @param {string} tag
 * @param {Record<string, any>} [properties] "class", "for", "role" and names with "-" are attributes; functions are
 *   listeners of the event behind "on"; others are properties of the element
 * @param {(Node | string)[]} children texts are shown as they are, never read as HTML
 * @returns {any}
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (["class", "for", "role"].includes(name) || name.includes("-")) element.setAttribute(name, String(value));
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

/** Show a text in an element, if it is not shown already. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Show or hide an element. */
export function setShown(element, isShown) {
  if (element.hidden === isShown) element.hidden = !isShown;
}

/**
 * Return a function that shows a list of values as children of an element: one child for each key, which is kept.
 *
 * @template T
 * @param {Element} parent
 * @param {(value: T) => string | number} getKey
 * @param {(value: T) => {element: Element, show: (value: T) => void}} makeItem
 * @returns {(values: T[]) => void}
 */
export function makeList(parent, getKey, makeItem) {
  const items = new Map();
  return (values) => {
    const keys = new Set(values.map(getKey));
    for (const [key, item] of items) {
      if (keys.has(key)) continue;
      item.element.remove();
      items.delete(key);
    }
    values.forEach((value, place) => {
      const key = getKey(value);
      if (!items.has(key)) items.set(key, makeItem(value));
      const item = items.get(key);
      if (parent.children[place] !== item.element) insertAt(parent, item.element, place);
      item.show(value);
    });
  };
}

/** Insert an element as the child at a place; if it had the focus, it has it afterwards too. */
function insertAt(parent, element, place) {
  const focused = element.contains(document.activeElement) ? document.activeElement : null;
  parent.insertBefore(element, parent.children[place] ?? null);
  focused?.focus();
}

/**
 * Return a label with a field below it.
 *
 * @param {string} label
 * @param {HTMLElement} field input or select
 */
export function makeField(label, field) {
  return make("label", { class: "field" }, make("span", {}, label), field);
}

/**
 * Return a box to tick, with its label.
 *
 * @param {string} label
 * @param {boolean} checked
 */
export function makeCheckbox(label, checked = false) {
  const input = make("input", { type: "checkbox", checked });
  return { input, element: make("label", { class: "choice" }, input, label) };
}
