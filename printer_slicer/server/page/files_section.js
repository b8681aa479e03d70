/**
 * Files of G-code that can be printed.
 */
import { submitWith } from "./buttons.js";
import { make, makeCheckbox, makeField, makeList, setShown, setText } from "./elements.js";
import { makeUpload } from "./file_upload.js";
import { formatFacts, formatSize, formatTime } from "./formats.js";
import { tell, tellError } from "./messages.js";
import { request } from "./requests.js";
import { allows, known } from "./status.js";

/** Return the section with the files. */
export function makeFilesSection() {
  const list = make("ul", { class: "plain" });
  const empty = make("p", { hidden: true }, "There are no files yet.");
  const showFiles = makeList(list, ([file]) => file.id, makeFileRow);
  let revision = -1;

  const load = async () => {
    const files = await request("GET", "/v1/files");
    setShown(empty, files.length === 0);
    showFiles(files);
  };
  const upload = makeUpload(() => load().catch(tellError));
  return {
    title: "Files",
    element: make("div", {}, upload, list, empty),
    show() {
      setShown(upload, allows("upload"));
      if (!known.queue || revision === known.queue.revision) return;
      revision = known.queue.revision;
      load().catch(() => (revision = -1));
    },
  };
}

/** Return the row of a file, with the form that adds jobs for it. */
function makeFileRow([file]) {
  const title = make("h3", {});
  const figures = make("p", { class: "hint" });
  const facts = make("p", {});
  const form = makeJobForm(file);
  const address = `/v1/files/${file.id}`;
  const view = make("a", { class: "button", href: `${address}/view`, target: "_blank", rel: "noopener" }, "Look at it");
  const save = make("a", { class: "button", href: `${address}/content` }, "Save");
  const links = make("div", { class: "row" }, view, save);
  return {
    element: make("li", { class: "card" }, title, facts, figures, links, form.element),
    show([now, itsFacts]) {
      setText(title, now.name);
      view.setAttribute("aria-label", `Look at ${now.name}`);
      save.setAttribute("aria-label", `Save ${now.name}`);
      setShown(view, !itsFacts?.problem);
      setText(facts, formatFacts(itsFacts));
      facts.classList.toggle("warning", Boolean(itsFacts?.problem));
      setText(figures, `${formatSize(now.size)}, added ${formatTime(now.added)}`);
      setShown(form.element, allows("print") && !itsFacts?.problem);
      form.showPrinters();
    },
  };
}

/** Return the form that adds jobs for a file. */
function makeJobForm(file) {
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
  return {
    element,
    /** Offer the printers that exist now. */
    showPrinters() {
      const names = (known.queue?.printers ?? []).map((one) => one.name);
      if (printer.dataset.shown === names.join("\n")) return;
      printer.dataset.shown = names.join("\n");
      const choices = names.map((name) => make("option", { value: name }, name));
      printer.replaceChildren(make("option", { value: "" }, "any that fits"), ...choices);
    },
  };
}
