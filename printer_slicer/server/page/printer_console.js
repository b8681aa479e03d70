/**
 * The console of a printer: what it reports, and an input for commands.
 */
import { submitWith } from "./buttons.js";
import { make, makeCheckbox, makeField, makeList, setText } from "./elements.js";
import { request } from "./requests.js";

const SHOWN_LINES = 100;
const TEMPERATURES = /^(ok )?[TBC]\d*:\s*-?[\d.]+|^(T|B)\d*:|\bM105\b/;
const COMMANDS = "pause, pause now, resume, cancel, speed 80, flow 95, fan 50, nozzle 210, bed 60, babystep 0.05, say M117 hello, object NAME";

/**
 * Return a console.
 *
 * @param {string} printer
 * @param {(command: string) => Promise<unknown>} send
 */
export function makeConsole(printer, send) {
  const lines = make("ol", { class: "lines", tabIndex: 0, "aria-label": `Console of ${printer}` });
  const input = make("input", { autocomplete: "off", spellcheck: false, autocapitalize: "none" });
  const answer = make("output", {});
  const hint = make("p", { class: "hint" }, `Commands: ${COMMANDS}`);
  const form = make(
    "form",
    { class: "row" },
    makeField("Command", input),
    make("button", { type: "submit" }, "Send"),
  );
  submitWith(form, async () => {
    if (!input.value.trim()) return;
    const result = await send(input.value.trim());
    setText(answer, typeof result?.answer === "string" ? result.answer : "");
    input.value = "";
  });
  const filter = makeCheckbox("Hide temperatures", true);
  const find = make("input", { type: "search", autocomplete: "off", spellcheck: false });
  const filters = make("div", { class: "row" }, makeField("Filter", find), filter.element);
  const element = make("details", { class: "console" }, make("summary", {}, "Console"), filters, lines, answer, form, hint);
  let last = /** @type {[number, string, string][]} */ ([]);
  const redraw = () => show(last);
  find.addEventListener("input", redraw);
  filter.input.addEventListener("change", redraw);
  element.addEventListener("toggle", redraw);
  const isShown = ([, kind, text]) =>
    !(filter.input.checked && TEMPERATURES.test(text)) && `${kind} ${text}`.toLowerCase().includes(find.value.trim().toLowerCase());
  const show = (all) => {
    last = all;
    if (!element.open) return;
    const isAtEnd = lines.scrollHeight - lines.scrollTop - lines.clientHeight < 30;
    showLines(all.filter(isShown).slice(-SHOWN_LINES));
    if (isAtEnd) lines.scrollTop = lines.scrollHeight;
  };
  const showLines = makeList(lines, ([number]) => number, makeLine);
  return {
    element,
    form,
    /** Show the last lines; nothing is drawn while the console is folded. @type {(all: [number, string, string][]) => void} */
    show,
  };
}

/** Return a line of the console. */
function makeLine([, kind, text]) {
  const element = make("li", { "data-kind": kind }, make("span", { class: "kind" }, kind), ` ${text}`);
  return { element, show: () => {} };
}

/**
 * Send a command to the print on a printer.
 *
 * @param {string} printer
 * @param {string} command in the words of `printer-slicer control`
 */
export function sendCommand(printer, command) {
  return request("POST", `/v1/printers/${encodeURIComponent(printer)}/command`, { command });
}
