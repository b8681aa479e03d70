/**
 * Upload of G-code: dropped on the page, or chosen.
 */
import { make, setShown, setText } from "./elements.js";
import { tell, tellError } from "./messages.js";
import { uploadFile } from "./requests.js";

/**
 * Return the place for files to upload.
 *
 * @param {() => void} onUploaded
 */
export function makeUpload(onUploaded) {
  const input = make("input", { type: "file", multiple: true, accept: ".gcode,.gco,.g,.bgcode", class: "unseen", onchange: () => uploadAll([...input.files]) });
  const label = make("label", { class: "button" }, input, "Choose G-code …");
  const progress = make("progress", { max: 1, value: 0, "aria-label": "Upload" });
  const text = make("p", { class: "hint" });
  const row = make("div", { hidden: true }, text, progress);
  const element = make("div", { class: "drop" }, make("p", {}, "Drop G-code here, or"), label, row);

  const uploadAll = async (files) => {
    setShown(row, true);
    for (const file of files) {
      setText(text, `Uploading ${file.name}`);
      try {
        const [stored, facts] = await uploadFile(file, (share) => (progress.value = share));
        tell(facts.problem ? `${stored.name} cannot be printed: ${facts.problem}` : `${stored.name} is uploaded`);
      } catch (error) {
        tellError(error);
      }
    }
    setShown(row, false);
    input.value = "";
    onUploaded();
  };
  const mark = (isOver) => element.classList.toggle("over", isOver);
  element.addEventListener("dragover", (event) => {
    event.preventDefault();
    mark(true);
  });
  element.addEventListener("dragleave", () => mark(false));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    mark(false);
    uploadAll([...event.dataTransfer.files]);
  });
  return element;
}
