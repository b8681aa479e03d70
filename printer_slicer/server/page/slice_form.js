/**
 * The settings with which a model is sliced.
 */
import { submitWith } from "./buttons.js";
import { make, makeField } from "./elements.js";
import { fillPrinters } from "./job_form.js";
import { request } from "./requests.js";

const AS_QUALITY = "from the quality profile";
const PLANS = { "": AS_QUALITY, uniform: "uniform", optimal: "adaptive" };
const SUPPORTS = { "": AS_QUALITY, off: "none", auto: "where needed", tree: "trees" };
const DEFAULT_QUALITY = "standard";

/**
 * Return the form.
 *
 * @param {() => Promise<unknown>} act is called when the form is sent
 * @returns {{element: HTMLFormElement, buttons: HTMLElement, readFields: (planner?: string) => Record<string, string>,
 *   usePlan: (plan: string) => boolean, showChoices: () => void}} `readFields` returns the fields that `/v1/slices`
 *   takes, with a planner if none is chosen; `usePlan` takes over a layer plan and returns whether it can
 */
export function makeSliceForm(act) {
  const printer = make("select", { required: true });
  const quality = make("select", {});
  const plan = makeMenu(PLANS);
  const height = makeNumber({ min: 0.01, max: 1.6, step: 0.01 });
  const infill = makeNumber({ min: 0, max: 100, step: 1 });
  const supports = makeMenu(SUPPORTS);
  const brim = makeNumber({ min: 0, max: 50, step: 0.5 });
  const copies = make("input", { type: "number", min: 1, max: 200, step: 1, value: 1, required: true });
  const fields = [
    makeField("Printer", printer),
    makeField("Quality", quality),
    makeField("Layers", plan),
    makeField("Layer height, mm", height),
    makeField("Infill, %", infill),
    makeField("Supports", supports),
    makeField("Brim, mm", brim),
    makeField("Copies", copies),
  ];
  const submit = make("button", { type: "submit", class: "main" }, "Slice");
  const buttons = make("div", { class: "row" }, submit);
  const element = make("form", { class: "wide" }, make("div", { class: "dials" }, ...fields), buttons);
  submitWith(element, act);
  let isAsked = false;
  return {
    element,
    buttons,
    showChoices() {
      fillPrinters(printer);
      if (!isAsked) offerQualities(quality);
      isAsked = true;
    },
    readFields(planner = "") {
      const settings = listSettings({ planner: plan.value || planner, height, infill, supports, brim });
      return { printer: printer.value, quality: quality.value, copies: copies.value, settings: JSON.stringify(settings) };
    },
    usePlan(name) {
      const uniform = /^uniform ([\d.]+) mm$/.exec(name);
      if (!uniform && !name.startsWith("optimal")) return false;
      plan.value = uniform ? "uniform" : "optimal";
      height.value = uniform ? uniform[1] : "";
      return true;
    },
  };
}

/** Return the settings that differ from those of the quality. */
function listSettings({ planner, height, infill, supports, brim }) {
  const settings = {
    "planner.kind": planner,
    layer_height: height.value,
    infill_density: infill.value && String(infill.valueAsNumber / 100),
    support: supports.value,
    brim_width: brim.value,
  };
  return Object.fromEntries(Object.entries(settings).filter(([, value]) => value !== ""));
}

/** Return a field for a number that may be left empty. */
function makeNumber(bounds) {
  return make("input", { type: "number", inputMode: "decimal", placeholder: AS_QUALITY, ...bounds });
}

/** Return a menu. */
function makeMenu(choices) {
  return make("select", {}, ...Object.entries(choices).map(([value, text]) => make("option", { value }, text)));
}

/** Offer the quality profiles of the server. */
async function offerQualities(menu) {
  menu.append(make("option", { value: "" }, DEFAULT_QUALITY));
  const names = await request("GET", "/v1/profiles").then(
    (found) => found.quality,
    () => [],
  );
  const others = names.filter((name) => name !== DEFAULT_QUALITY);
  menu.append(...others.map((value) => make("option", { value }, value)));
}
