/**
 * One printer: what it prints, how warm it is, whether its bed is clear, and its controls.
 */
import { makeButton } from "./buttons.js";
import { make, makeList, setShown, setText } from "./elements.js";
import { findNextJob } from "./explanations.js";
import { formatDuration, formatTime } from "./formats.js";
import { makeLiveLayers } from "./live_layers.js";
import { makeMaterialForm } from "./material_form.js";
import { tell } from "./messages.js";
import { loadLayers } from "./preview_store.js";
import { followProgress } from "./print_progress.js";
import { makeConsole, sendCommand } from "./printer_console.js";
import { makeControls } from "./printer_controls.js";
import { describeState } from "./printer_state.js";
import { request } from "./requests.js";
import { allows, known } from "./status.js";
import { makeTemperatureChart } from "./temperature_chart.js";
import { nameHeater } from "./temperature_history.js";
import { makeWebcam } from "./webcam.js";

const BED_TEXTS = {
  clear: "Bed is clear",
  occupied: "Bed is occupied: take the print off",
  unknown: "The bed may be occupied: take the print off",
};

/**
 * Return the card of a printer.
 *
 * @param {any} printer as the feed tells it
 * @returns {{element: HTMLElement, show: (printer: any) => void}}
 */
export function makePrinterCard(printer) {
  const { name } = printer;
  const send = (command) => sendCommand(name, command);
  const parts = makeParts(name);
  const bed = makeBed(name);
  const controls = makeControls(send);
  const log = makeConsole(name, send);
  const layers = makeLiveLayers();
  const material = makeMaterialForm(name);
  const findProgress = makeProgress();
  const chart = makeTemperatureChart(name);
  const chartRow = make("details", { open: true, ontoggle: () => chart.show() }, make("summary", {}, "Temperatures"), parts.heaters, chart.element);
  const element = make(
    "li",
    { class: "card" },
    make("div", { class: "row" }, make("h3", { class: "grow" }, name), parts.state),
    parts.message,
    parts.work,
    bed.element,
    material.element,
    controls.element,
    layers.element,
    makeWebcam(printer),
    chartRow,
    log.element,
  );
  return {
    element,
    show(now) {
      const print = known.prints.get(name);
      const job = known.queue.jobs.find((one) => one.id === now.job);
      const progress = findProgress(print, job);
      parts.show(now, job, print?.status, progress);
      setShown(layers.element, Boolean(progress));
      bed.show(now);
      material.show(now);
      setShown(controls.element, Boolean(print) && allows("control", name));
      setShown(chartRow, Boolean(print));
      setShown(log.element, Boolean(print));
      setShown(log.form, allows("control", name));
      if (!print) return;
      controls.show(print.status);
      log.show(print.console);
      if (job) layers.show(job.file, progress);
      chart.show();
    },
  };
}

/** Return the texts of a card and the bar of progress. */
function makeParts(name) {
  const state = make("span", { class: "badge" });
  const message = make("p", { class: "warning" });
  const title = make("p", { class: "title" });
  const bar = make("progress", { max: 100, "aria-label": `Progress of ${name}` });
  const figures = make("p", { class: "figures" });
  const next = make("p", { class: "hint" });
  const heaters = make("ul", { class: "heaters figures" });
  const showHeaters = makeList(heaters, ([heater]) => heater, makeHeater);
  const work = make("div", {}, title, bar, figures, next);
  const show = (printer, job, status, progress) => {
    const word = describeState(job, status);
    setText(state, word);
    state.dataset.state = word;
    setShown(message, Boolean(printer.message));
    setText(message, printer.message);
    setText(title, job ? job.name : "Not printing");
    setShown(bar, Boolean(job));
    bar.value = getPercent(status);
    setText(figures, job ? describeProgress(status, progress) : "");
    setText(next, describeNext(name));
    showHeaters(Object.entries(status?.temperatures ?? {}));
  };
  return { state, message, work, heaters, show };
}

/** Return the state of the bed, with a button that declares it clear. */
function makeBed(name) {
  const text = make("p", { class: "grow" });
  const declare = async (bed) => {
    await request("PUT", `/v1/printers/${encodeURIComponent(name)}/bed`, { bed });
    tell(bed === "clear" ? `The bed of ${name} is clear; the next job may start` : `The bed of ${name} is not clear`);
  };
  const clear = makeButton("Bed is clear", () => declare("clear"), { class: "main" });
  const occupied = makeButton("Not clear", () => declare("occupied"));
  const element = make("div", { class: "bed row" }, text, clear, occupied);
  return {
    element,
    show(printer) {
      const isFree = printer.job === null;
      setShown(element, isFree);
      element.dataset.bed = printer.bed;
      setText(text, BED_TEXTS[printer.bed]);
      setShown(clear, printer.bed !== "clear" && allows("control", name));
      setShown(occupied, printer.bed === "clear" && allows("control", name));
    },
  };
}

/** Return the progress of a print in percent. */
function getPercent(status) {
  return status?.total ? (100 * status.done) / status.total : 0;
}

/** Return a function that returns how far a print is; null if it is not known. */
function makeProgress() {
  let run = "";
  let layers = null;
  let follow = followProgress();
  return (print, job) => {
    if (!print || !job) return null;
    if (print.run !== run) {
      run = print.run;
      layers = null;
      follow = followProgress();
      const load = loadLayers(job.file);
      load.then(
        (found) => (layers = print.run === run ? found : layers),
        () => {}, // files without a preview are printed, too
      );
    }
    return layers && follow(print.status, layers, Date.now() / 1000);
  };
}

/** Return the progress of a print as text. */
function describeProgress(status, progress) {
  if (!status) return "starting";
  if (status.waits_for) return `waiting for ${status.waits_for}`;
  const parts = [`${getPercent(status).toFixed(0)} %`];
  if (status.layers) parts.unshift(`Layer ${status.layer} of ${status.layers}`);
  if (progress && Number.isFinite(progress.secondsLeft)) parts.push(describeTimeLeft(progress.secondsLeft));
  if (status.speed_percent !== 100) parts.push(`speed ${status.speed_percent} %`);
  if (status.flow_percent !== 100) parts.push(`flow ${status.flow_percent} %`);
  if (status.resends) parts.push(`${status.resends} resends`);
  return parts.join(" · ");
}

/** Return the time that is left and the time of the end as text. */
function describeTimeLeft(seconds) {
  return `${formatDuration(seconds)} left, ends ${formatTime(Date.now() / 1000 + seconds)}`;
}

/** Return the first job that waits for a printer as text. */
function describeNext(name) {
  const next = findNextJob(name);
  return next ? `Next: ${next.name}` : "No job waits for this printer";
}

/** Return the temperature of a heater, which has the colour of its line in the chart. */
function makeHeater([heater]) {
  const element = make("li", {});
  const show = ([, [actual, target]]) => setText(element, `${nameHeater(heater)} ${actual.toFixed(0)} / ${target.toFixed(0)} °C`);
  return { element, show };
}
