/**
 * A new job from a model: choose it and its settings, compare layer plans, slice it, look at its layers, and print it.
 */
import { makeButton } from "./buttons.js";
import { makeDropArea } from "./drop_area.js";
import { make, setShown, setText } from "./elements.js";
import { tell, tellError } from "./messages.js";
import { MODEL_SUFFIXES } from "./file_names.js";
import { makeSliceForm } from "./slice_form.js";
import { makePlans, makeSlicedFiles } from "./slice_result.js";
import { makeSliceTask } from "./slice_task.js";
import { allows } from "./status.js";

const TEXTS = { text: "Drop a model here, or", label: "Choose a model …", accept: MODEL_SUFFIXES.join(), multiple: false };

/** Return the section. */
export function makeNewJobSection() {
  let model = /** @type {File | null} */ (null);
  const name = make("h3", { tabIndex: -1 });
  const task = makeSliceTask();
  const result = make("div", {});
  const form = makeSliceForm(() => slice());
  const compare = makeButton("Compare layer plans", () => plan());
  form.buttons.append(compare);
  const settings = make("div", { class: "card", hidden: true }, name, form.element);
  const drop = makeDropArea(TEXTS, ([file]) => {
    model = file;
    setText(name, file.name);
    setShown(settings, true);
    result.replaceChildren();
    name.focus();
  });
  const show = async (ended) => {
    if (ended.state === "cancelled") return tell(`${ended.name} is cancelled`);
    if (ended.command === "slice") tell(`${ended.name} is sliced`);
    result.replaceChildren(ended.command === "plan" ? makePlans(ended, form.usePlan) : await makeSlicedFiles(ended));
    return result.querySelector("h3, caption").focus();
  };
  const work = async (path, fields) => {
    if (task.isRunning()) return tell("Wait for the end of the work on this model, or cancel it");
    result.replaceChildren();
    return show(await task.run(path, model, fields));
  };
  const slice = () => work("/v1/slices", form.readFields());
  const plan = async () => {
    if (form.element.reportValidity()) await work("/v1/plans", form.readFields("optimal"));
  };
  const resume = async () => {
    const ended = await task.resume();
    if (ended) await show(ended);
  };
  let isResumed = false;
  const refused = make("p", {}, "Your key does not allow uploads.");
  return {
    title: "New job",
    element: make("div", {}, refused, drop, settings, task.element, result),
    show() {
      setShown(refused, !allows("upload"));
      setShown(drop, allows("upload"));
      form.showChoices();
      if (!isResumed) resume().catch(tellError);
      isResumed = true;
    },
  };
}
