/**
 * The form that adds jobs for a file.
 */
import { submitWith } from "./buttons.js";
import { make, makeCheckbox, makeField } from "./elements.js";
import { tell } from "./messages.js";
import { request } from "./requests.js";
import { known } from "./status.js";

/**
 * Return the form.
 *
 * @param {{id: string, name: string}} file
 * @param {string} [chosen] name of the printer that is chosen first; empty: any that fits
 */
export function makeJobForm(file, chosen = "") {
  const printer = make("select", {});
  const copies = make("input", { type: "number", min: 1, max: 99, step: 1, value: 1, required: true });
  const held = makeCheckbox("Hold until released");
  const first = makeCheckbox("Before all others");
  const submit = make("button", { type: "submit", class: "main", "aria-label": `Print ${file.name}` }, "Print");
  const fields = make("div", { class: "row" }, makeField("Printer", printer), makeField("Copies", copies));
  const options = make("details", { class: "grow" }, make("summary", {}, "Options"), fields, held.element, first.element);
  const element = make("form", { class: "row top" }, submit, options);
  submitWith(element, async () => {
    const jobs = await request("POST", "/v1/jobs", {
      file: file.id,
      printer: printer.value,
      copies: copies.valueAsNumber,
      held: held.input.checked,
      first: first.input.checked,
    });
    tell(`${file.name} is in the queue as job ${jobs.map((job) => job.id).join(", ")}`);
  });
  const showPrinters = () => {
    if (fillPrinters(printer, "any that fits") && chosen) printer.value = chosen;
  };
  showPrinters();
  return { element, showPrinters };
}

/**
 * Offer the printers that exist now, and return whether they have changed.
 *
 * @param {HTMLSelectElement} menu
 * @param {string} [none] text of the choice of no printer; empty: there is no such choice
 */
export function fillPrinters(menu, none = "") {
  const names = (known.queue?.printers ?? []).map((one) => one.name);
  if (menu.dataset.shown === names.join("\n")) return false;
  menu.dataset.shown = names.join("\n");
  const before = menu.value;
  const choices = names.map((name) => make("option", { value: name }, name));
  menu.replaceChildren(...(none ? [make("option", { value: "" }, none)] : []), ...choices);
  if (names.includes(before)) menu.value = before;
  return true;
}
