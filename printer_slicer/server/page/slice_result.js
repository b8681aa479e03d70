/**
 * What became of a model: its layer plans, or the sliced files with their layers, findings and the form to print them.
 */
import { makeButton } from "./buttons.js";
import { make, setShown } from "./elements.js";
import { formatDuration, formatFacts } from "./formats.js";
import { makeJobForm } from "./job_form.js";
import { makeLayerBrowser } from "./layer_browser.js";
import { tell } from "./messages.js";
import { request } from "./requests.js";
import { allows } from "./status.js";

/**
 * Return a table of layer plans.
 *
 * @param {any} task
 * @param {(plan: string) => boolean} use takes over a plan, if it can
 */
export function makePlans(task, use) {
  const makeRow = (plan) => {
    const act = () => tell(use(plan.plan) ? `The layers are now ${plan.plan}` : "Choose the layers in the form");
    const button = makeButton("Use", act, { "aria-label": `Use ${plan.plan}` });
    const texts = [String(plan.layers), formatDuration(plan.seconds), `${plan.max_error_mm.toFixed(2)} mm`];
    return make("tr", {}, make("th", { scope: "row" }, plan.plan), ...texts.map((text) => make("td", {}, text)), make("td", {}, button));
  };
  const titles = ["Plan", "Layers", "Time", "Deviation", ""].map((text) => make("th", { scope: "col" }, text));
  const table = make("table", { class: "figures" }, make("caption", { tabIndex: -1 }, `Layer plans of ${task.name}`), make("tr", {}, ...titles), ...task.facts[0].plans.map(makeRow));
  return make("div", { class: "card" }, table);
}

/**
 * Return the sliced files.
 *
 * @param {any} task
 */
export async function makeSlicedFiles(task) {
  const files = await Promise.all(task.files.map((id) => request("GET", `/v1/files/${id}`)));
  return make("div", { class: "stack" }, makeFindings(task), ...files.map((entry) => makeSlicedFile(task, entry)));
}

/** Return the findings of a task. */
function makeFindings({ name, message, facts }) {
  const found = [...message.split("\n"), ...facts.flatMap((one) => [...(one.warnings ?? []), ...describeOverhangs(one.overhangs)])];
  const lines = [...new Set(found.filter(Boolean))];
  const list = make("ul", {}, ...lines.map((line) => make("li", {}, line)));
  const errors = facts.map((one) => one.certificate?.max_error_mm).filter((one) => one !== undefined);
  const error = Math.max(...errors);
  const accuracy = errors.length === 0 ? "" : ` · the layers deviate from the surface by at most ${error.toFixed(2)} mm`;
  const title = lines.length ? "Findings" : "No findings";
  return make("div", { class: "card" }, make("h3", { tabIndex: -1 }, `${name} is sliced`), make("p", {}, `${title}${accuracy}`), list);
}

/** Return what the overhangs without supports are, one sentence each. @param {any} facts null if there are none */
function describeOverhangs(facts) {
  if (!facts) return [];
  const { islands, area_mm2: area, threshold_deg: angle, largest } = facts;
  const place = largest.length ? `, the largest at z ${largest[0].z.toFixed(1)} mm` : "";
  const texts = [`${area.toFixed(0)} mm² of overhangs are flatter than ${angle}° and have no supports${place}`];
  return islands ? [`${islands} islands begin with nothing below them`, ...texts] : texts;
}

/** Return a sliced file with its layers and the form that prints it. */
function makeSlicedFile(task, [file, facts]) {
  const form = makeJobForm(file, task.printer);
  setShown(form.element, allows("print") && !facts.problem);
  const view = make("a", { class: "button", href: `/v1/files/${file.id}/view`, target: "_blank", rel: "noopener" }, "All layers in 3D");
  return make("div", { class: "card" }, make("h3", {}, file.name), make("p", {}, formatFacts(facts)), makeLayerBrowser(file.id), make("div", { class: "row" }, view), form.element);
}
