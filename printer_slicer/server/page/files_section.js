/**
 * Files of G-code that can be printed.
 */
import { makeConfirmedButton } from "./buttons.js";
import { make, makeList, setShown, setText } from "./elements.js";
import { makeUpload } from "./file_upload.js";
import { formatFacts, formatSize, formatTime } from "./formats.js";
import { makeJobForm } from "./job_form.js";
import { tell, tellError } from "./messages.js";
import { request } from "./requests.js";
import { allows, known } from "./status.js";

/** Return the section with the files. */
export function makeFilesSection() {
  const list = make("ul", { class: "plain" });
  const empty = make("p", { hidden: true }, "There are no files yet.");
  const showFiles = makeList(list, ([file]) => file.id, (entry) => makeFileRow(entry, load));
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

/** Return the row of a file, with the form that adds jobs for it; `reload` shows the files again. */
function makeFileRow([file], reload) {
  const title = make("h3", {});
  const figures = make("p", { class: "hint" });
  const facts = make("p", {});
  const form = makeJobForm(file);
  const address = `/v1/files/${file.id}`;
  const view = make("a", { class: "button", href: `${address}/view`, target: "_blank", rel: "noopener" }, "View");
  const save = make("a", { class: "button", href: `${address}/content` }, "Save");
  const remove = makeConfirmedButton("Delete", "Press again to delete", async () => {
    await request("DELETE", address);
    tell(`${file.name} is deleted`);
    await reload();
  });
  const links = make("div", { class: "row" }, view, save, remove);
  return {
    element: make("li", { class: "card" }, title, facts, figures, links, form.element),
    show([now, itsFacts]) {
      setText(title, now.name);
      view.setAttribute("aria-label", `View ${now.name}`);
      save.setAttribute("aria-label", `Save ${now.name}`);
      setShown(view, !itsFacts?.problem);
      setShown(remove, allows("print") && !known.account?.printer);
      setText(facts, formatFacts(itsFacts));
      facts.classList.toggle("warning", Boolean(itsFacts?.problem));
      setText(figures, `${formatSize(now.size)}, added ${formatTime(now.added)}`);
      setShown(form.element, allows("print") && !itsFacts?.problem);
      form.showPrinters();
    },
  };
}
