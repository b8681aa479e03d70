/**
 * The layers of a file, one after the other behind a slider.
 */
import { make, makeField, setText } from "./elements.js";
import { makeLayerPicture } from "./layer_picture.js";
import { loadPreview } from "./preview_store.js";

/**
 * Return the layers of a file; what goes wrong is said in their place.
 *
 * @param {string} file
 */
export function makeLayerBrowser(file) {
  const picture = makeLayerPicture();
  const slider = make("input", { type: "range", min: 1, max: 1, value: 1, disabled: true });
  const text = make("output", { class: "figures" }, "Loading the layers …");
  const show = (loaded) => {
    const layer = slider.valueAsNumber - 1;
    const { z, height } = loaded.preview.layers;
    const said = `Layer at ${z[layer].toFixed(2)} mm, ${height[layer].toFixed(2)} mm high, ${layer + 1} of ${z.length}`;
    setText(text, said);
    slider.setAttribute("aria-valuetext", said);
    picture.show(loaded, layer, 1, said);
  };
  const begin = async () => {
    try {
      const loaded = await loadPreview(file);
      slider.max = String(loaded.preview.layers.z.length);
      slider.value = String(Math.ceil(loaded.preview.layers.z.length / 2));
      slider.disabled = false;
      slider.addEventListener("input", () => show(loaded));
      show(loaded);
    } catch (error) {
      setText(text, error.message);
    }
  };
  begin();
  return make("div", { class: "layers" }, picture.element, makeField("Layer", slider), text);
}
