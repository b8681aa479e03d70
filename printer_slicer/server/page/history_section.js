/**
 * Jobs that have ended.
 */
import { makeButton, makeConfirmedButton } from "./buttons.js";
import { make, makeList, setShown, setText } from "./elements.js";
import { formatDuration, formatTime } from "./formats.js";
import { tell } from "./messages.js";
import { request } from "./requests.js";
import { allows, known } from "./status.js";

/** Return the section with the history. */
export function makeHistorySection() {
  const list = make("ul", { class: "plain" });
  const empty = make("p", { hidden: true }, "No print has ended yet.");
  const showEnded = makeList(list, ([job]) => job.id, makeEndedRow);
  let revision = -1;

  const load = async () => {
    const ended = await request("GET", "/v1/history");
    setShown(empty, ended.length === 0);
    showEnded(ended);
  };
  return {
    title: "History",
    element: make("div", {}, list, empty),
    show() {
      if (!known.queue || revision === known.queue.revision) return;
      revision = known.queue.revision;
      load().catch(() => (revision = -1));
    },
  };
}

/** Return the row of a job that has ended. */
function makeEndedRow([job]) {
  const state = make("span", { class: "badge" });
  const message = make("p", {});
  const figures = make("p", { class: "hint" });
  let findings = /** @type {string[]} */ ([]);
  const print = async (allow) => {
    const { file, name, printer, material } = job;
    const [added] = await request("POST", "/v1/jobs", { file, name, printer, material, allow });
    tell(`${name} is in the queue as job ${added.id}`);
  };
  const again = makeButton("Print again", () => print(job.allow), { "aria-label": `Print ${job.name} again` });
  const anyway = makeConfirmedButton("Print anyway", "Press again to print anyway", () => print([...job.allow, ...findings]));
  const head = make("div", { class: "row" }, make("h3", { class: "grow" }, `${job.id} · ${job.name}`), state);
  return {
    element: make("li", { class: "card" }, head, message, make("div", { class: "row" }, make("div", { class: "grow" }, figures), again, anyway)),
    show([now, run]) {
      setText(state, now.state);
      state.dataset.state = now.state;
      setShown(message, Boolean(now.message));
      setText(message, now.message);
      setText(figures, describeRun(run));
      findings = run?.findings ?? [];
      const mayPrint = allows("print", now.printer);
      setShown(again, mayPrint && findings.length === 0);
      setShown(anyway, mayPrint && findings.length > 0);
    },
  };
}

/** Return where and when a job was printed. */
function describeRun(run) {
  if (!run) return "never started";
  const start = `${run.printer}, started ${formatTime(run.started)}`;
  return run.ended ? `${start}, took ${formatDuration(run.ended - run.started)}` : start;
}
