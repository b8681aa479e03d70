/**
 * The material that is loaded on a printer, and the form that names another one.
 */
import { submitWith } from "./buttons.js";
import { make, makeField, setShown, setText } from "./elements.js";
import { tell } from "./messages.js";
import { request } from "./requests.js";
import { allows } from "./status.js";

/**
 * Return the form, which is folded.
 *
 * @param {string} name of the printer
 * @returns {{element: HTMLElement, show: (printer: any) => void}}
 */
export function makeMaterialForm(name) {
  const summary = make("summary", {});
  const menu = make("select", { required: true });
  const form = make("form", { class: "row" }, makeField("Loaded material", menu), make("button", { type: "submit" }, "Set"));
  const element = make("details", {}, summary, form);
  let loaded = "";
  element.addEventListener("toggle", async () => {
    if (!element.open || menu.options.length) return;
    const { material } = await request("GET", "/v1/profiles").catch(() => ({ material: [loaded] }));
    menu.replaceChildren(...material.map((value) => make("option", { value }, value.toUpperCase())));
    menu.value = loaded;
  });
  submitWith(form, async () => {
    await request("PUT", `/v1/printers/${encodeURIComponent(name)}/material`, { material: menu.value });
    tell(`${menu.value.toUpperCase()} is loaded on ${name}`);
  });
  return {
    element,
    show({ material, job }) {
      loaded = material;
      setText(summary, `${material.toUpperCase()} is loaded`);
      setShown(element, job === null && allows("control", name));
    },
  };
}
