/**
 * A model on the server: it is uploaded, and then sliced or its layer plans are compared, with its progress.
 */
import { makeConfirmedButton } from "./buttons.js";
import { make, setShown, setText } from "./elements.js";
import { request, uploadFile } from "./requests.js";

const STAGES = ["starting", "loading", "repairing", "placing", "planning", "slicing", "perimeters", "regions", "toolpaths", "ordering", "travels", "extrusion", "writing"];
const PAUSE = 300; // ms
const LAST_TASK = "printer_slicer_task";

/**
 * Return the progress, and functions that follow a task until it ends.
 *
 * @returns {{element: HTMLElement, isRunning: () => boolean, resume: () => Promise<any>,
 *   run: (path: string, model: File, fields: Record<string, string>) => Promise<any>}}
 *   both return the task that has ended, and throw an error if it has failed; `resume` follows the last task of this
 *   tab after the page was loaded again, and returns null if there is none
 */
export function makeSliceTask() {
  const text = make("p", { role: "status" });
  const bar = make("progress", { max: 1, value: 0, "aria-label": "Slicing" });
  let task = /** @type {any} */ (null);
  const cancel = makeConfirmedButton("Cancel slicing", "Press again to cancel", () => task && request("DELETE", `/v1/slices/${task.id}`));
  const element = make("div", { class: "card", hidden: true }, text, bar, cancel);

  const follow = async () => {
    sessionStorage.setItem(LAST_TASK, task.id);
    while (task.state === "waiting" || task.state === "slicing") {
      setShown(cancel, true);
      setText(text, `${task.name}: ${task.stage || "waiting"}`);
      bar.value = findShare(task.stage);
      await new Promise((resume) => setTimeout(resume, PAUSE));
      task = await findTask(task.id).catch((error) => {
        if (error.status) throw error;
        return task; // the server cannot be reached at the moment
      });
    }
    if (task.state === "failed") throw new Error(task.message);
    return task;
  };
  const show = async (first, begin) => {
    setShown(element, true);
    setShown(cancel, false);
    setText(text, first);
    try {
      task = await begin();
      return await follow();
    } finally {
      task = null;
      setShown(element, false);
    }
  };
  const run = (path, model, fields) => {
    sessionStorage.removeItem(LAST_TASK);
    const ended = show(`Uploading ${model.name}`, () => uploadFile(path, { ...fields, file: model }, (share) => (bar.value = share)));
    element.scrollIntoView({ block: "nearest" });
    return ended;
  };
  const resume = async () => {
    const id = sessionStorage.getItem(LAST_TASK);
    sessionStorage.removeItem(LAST_TASK);
    return id && show("Looking for the last model", () => findTask(id));
  };
  return { element, run, resume, isRunning: () => !element.hidden };
}

/** Return a task as it is now. */
function findTask(id) {
  return request("GET", `/v1/slices/${id}`);
}

/** Return how much is done when a stage begins, 0 to 1. */
function findShare(stage) {
  const place = STAGES.findIndex((one) => stage.startsWith(one));
  return Math.max(place, 0) / STAGES.length;
}
