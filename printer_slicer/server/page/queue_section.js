/**
 * The queue: its order, and why each job waits.
 */
import { makeButton, makeConfirmedButton } from "./buttons.js";
import { make, makeList, setShown, setText } from "./elements.js";
import { findExplanation, updateExplanations } from "./explanations.js";
import { tell } from "./messages.js";
import { request } from "./requests.js";
import { allows, known } from "./status.js";

const WAITING = ["ready", "held"];

/** Return the section with the queue. */
export function makeQueueSection() {
  const list = make("ol", { class: "plain" });
  const empty = make("p", { hidden: true }, "No job waits. Upload G-code under Files, and press Print.");
  const showJobs = makeList(list, (job) => job.id, makeJobRow);
  return {
    title: "Queue",
    element: make("div", {}, list, empty),
    show() {
      if (!known.queue) return;
      setShown(empty, known.queue.jobs.length === 0);
      showJobs(known.queue.jobs);
      updateExplanations(() => showJobs(known.queue.jobs));
    },
  };
}

/** Return the row of a job. */
function makeJobRow({ id, name }) {
  const path = `/v1/jobs/${id}`;
  const state = make("span", { class: "badge" });
  const reason = make("p", { class: "hint" });
  const reasons = make("ul", {});
  const details = make("details", {}, make("summary", {}, "Why it waits"), reasons);
  const up = makeButton("Up", () => moveJob(id, -1), { "aria-label": `Move ${name} up` });
  const down = makeButton("Down", () => moveJob(id, 1), { "aria-label": `Move ${name} down` });
  const hold = makeButton("Hold", () => request("PUT", `${path}/hold`), { "aria-label": `Hold ${name}` });
  const release = makeButton("Release", () => request("DELETE", `${path}/hold`), { "aria-label": `Release ${name}` });
  const cancel = makeConfirmedButton("Cancel job", "Press again to cancel", async () => {
    await request("DELETE", path);
    tell(`Job ${id} is cancelled`);
  });
  const buttons = make("div", { class: "row" }, up, down, hold, release, cancel);
  const head = make("div", { class: "row" }, make("h3", { class: "grow" }, `${id} · ${name}`), state);
  return {
    element: make("li", { class: "card" }, head, reason, details, buttons),
    show(job) {
      const isWaiting = WAITING.includes(job.state);
      const explanation = findExplanation(id);
      setText(state, job.state);
      state.dataset.state = job.state;
      setText(reason, describeJob(job, isWaiting && explanation?.summary));
      setShown(details, isWaiting && Boolean(explanation));
      showReasons(reasons, explanation);
      setShown(buttons, allows("print", job.printer));
      for (const button of [up, down]) setShown(button, isWaiting);
      setShown(hold, job.state === "ready");
      setShown(release, job.state === "held");
    },
  };
}

/** Return what is wanted of a job, and why it waits. */
function describeJob(job, summary) {
  const wanted = [job.printer && `for ${job.printer}`, job.material && job.material.toUpperCase()];
  const run = known.queue.runs.find((one) => one.job === job.id);
  const text = run ? `on ${run.printer}${run.is_cancelling ? ", is being cancelled" : ""}` : summary || job.message;
  return [...wanted, text].filter(Boolean).join(" · ");
}

/** Show for each printer why it does not print a job now. */
function showReasons(list, explanation) {
  const texts = (explanation?.printers ?? []).map((one) => `${one.printer}: ${one.reasons.join("; ") || "ready to print it"}`);
  if (list.dataset.shown === texts.join("\n")) return;
  list.dataset.shown = texts.join("\n");
  list.replaceChildren(...texts.map((text) => make("li", {}, text)));
}

/** Move a job before the waiting job above it, or behind the one below it. */
async function moveJob(id, step) {
  const waiting = known.queue.jobs.filter((job) => WAITING.includes(job.state)).map((job) => job.id);
  const place = waiting.indexOf(id);
  const target = place + step;
  if (target < 0 || target >= waiting.length) {
    tell(step < 0 ? "The job is the first one" : "The job is the last one");
    return;
  }
  const before = step < 0 ? waiting[target] : (waiting[target + 1] ?? null);
  await request("PUT", `/v1/jobs/${id}/place`, { before });
  tell(`Job ${id} is number ${target + 1} in the queue`);
}
