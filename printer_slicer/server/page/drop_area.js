/**
 * A place where files are dropped or chosen.
 */
import { make } from "./elements.js";

/**
 * Return the place.
 *
 * @param {{text: string, label: string, accept: string, multiple: boolean}} texts of the place and its button, and the
 *   endings of files to choose
 * @param {(files: File[]) => void} onFiles
 */
export function makeDropArea({ text, label, accept, multiple }, onFiles) {
  const choose = () => {
    const files = [...input.files];
    input.value = "";
    if (files.length) onFiles(files);
  };
  const input = make("input", { type: "file", multiple, accept, class: "unseen", onchange: choose });
  const element = make("div", { class: "drop" }, make("p", {}, text), make("label", { class: "button" }, input, label));
  const mark = (isOver) => element.classList.toggle("over", isOver);
  element.addEventListener("dragover", (event) => {
    event.preventDefault();
    mark(true);
  });
  element.addEventListener("dragleave", () => mark(false));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    mark(false);
    const files = [...event.dataTransfer.files];
    if (files.length) onFiles(multiple ? files : files.slice(0, 1));
  });
  return element;
}
