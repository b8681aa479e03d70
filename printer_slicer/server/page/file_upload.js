/**
 * Upload of G-code: dropped on the page, or chosen.
 */
import { makeDropArea } from "./drop_area.js";
import { make, setShown, setText } from "./elements.js";
import { GCODE_SUFFIXES, isModel } from "./file_names.js";
import { tell, tellError } from "./messages.js";
import { uploadFile } from "./requests.js";

/**
 * Return the place for files to upload.
 *
 * @param {() => void} onUploaded
 */
export function makeUpload(onUploaded) {
  const progress = make("progress", { max: 1, value: 0, "aria-label": "Upload" });
  const text = make("p", { class: "hint" });
  const row = make("div", { hidden: true }, text, progress);
  const uploadAll = async (files) => {
    setShown(row, true);
    for (const file of files) {
      if (isModel(file.name)) {
        tellError(`${file.name} is a model. Drop it under New job.`);
        continue;
      }
      setText(text, `Uploading ${file.name}`);
      try {
        const [stored, facts] = await uploadFile("/v1/files", { file }, (share) => (progress.value = share));
        tell(facts.problem ? `${stored.name} cannot be printed: ${facts.problem}` : `${stored.name} is uploaded`);
      } catch (error) {
        tellError(error);
      }
    }
    setShown(row, false);
    onUploaded();
  };
  const texts = { text: "Drop G-code here, or", label: "Choose G-code …", accept: GCODE_SUFFIXES.join(), multiple: true };
  const element = makeDropArea(texts, uploadAll);
  element.append(row);
  return element;
}
