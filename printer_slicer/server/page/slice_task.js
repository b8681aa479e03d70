/**
 * A model on the server: it is uploaded, and then sliced or its layer plans are compared, with its progress.
 */
import { makeConfirmedButton } from "./buttons.js";
import { make, setShown, setText } from "./elements.js";
import { request, uploadFile } from "./requests.js";

const STAGES = ["starting", "loading", "repairing", "placing", "planning", "slicing", "perimeters", "regions", "toolpaths", "ordering", "travels", "extrusion", "writing"];
const PAUSE = 300; // ms

/**
 * Return the progress, and a function that runs a task until it ends.
 *
 * @returns {{element: HTMLElement, isRunning: () => boolean,
 *   run: (path: string, model: File, fields: Record<string, string>) => Promise<any>}}
 *   `run` returns the task that has ended, and throws an error if it has failed
 */
export function makeSliceTask() {
  const text = make("p", { role: "status" });
  const bar = make("progress", { max: 1, value: 0, "aria-label": "Slicing" });
  let task = /** @type {any} */ (null);
  const cancel = makeConfirmedButton("Cancel slicing", "Press again to cancel", () => task && request("DELETE", `/v1/slices/${task.id}`));
  const element = make("div", { class: "card", hidden: true }, text, bar, cancel);

  const follow = async () => {
    while (task.state === "waiting" || task.state === "slicing") {
      setShown(cancel, true);
      setText(text, `${task.name}: ${task.stage || "waiting"}`);
      bar.value = findShare(task.stage);
      await new Promise((resume) => setTimeout(resume, PAUSE));
      task = await request("GET", `/v1/slices/${task.id}`);
    }
    return task;
  };
  const run = async (path, model, fields) => {
    setShown(element, true);
    setShown(cancel, false);
    element.scrollIntoView({ block: "nearest" });
    setText(text, `Uploading ${model.name}`);
    try {
      task = await uploadFile(path, { ...fields, file: model }, (share) => (bar.value = share));
      const ended = await follow();
      if (ended.state === "failed") throw new Error(ended.message);
      return ended;
    } finally {
      task = null;
      setShown(element, false);
    }
  };
  return { element, run, isRunning: () => !element.hidden };
}

/** Return how much is done when a stage begins, 0 to 1. */
function findShare(stage) {
  const place = STAGES.findIndex((one) => stage.startsWith(one));
  return Math.max(place, 0) / STAGES.length;
}
