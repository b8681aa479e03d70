/**
 * The layer that a printer prints at the moment.
 */
import { make, setText } from "./elements.js";
import { makeLayerPicture } from "./layer_picture.js";
import { loadPreview } from "./preview_store.js";

const PICTURES = 50; // of a layer, because drawing a large one takes time

/**
 * Return the picture, which is loaded and drawn only while it is unfolded.
 *
 * @returns {{element: HTMLDetailsElement, show: (file: string, progress: import("./print_progress.js").Progress | null) => void}}
 */
export function makeLiveLayers() {
  const picture = makeLayerPicture();
  const text = make("p", { class: "hint" });
  let last = () => {};
  const element = make("details", { ontoggle: () => last() }, make("summary", {}, "Current layer"), picture.element, text);
  const show = async (file, progress) => {
    last = () => show(file, progress);
    if (!element.open || !progress) return;
    try {
      const loaded = await loadPreview(file);
      const said = `Layer at ${loaded.preview.layers.z[progress.layer].toFixed(2)} mm`;
      const share = Math.floor(PICTURES * progress.share) / PICTURES;
      picture.show(loaded, progress.layer, share, `${said}, ${Math.round(100 * share)} % of it is printed`);
      setText(text, `${said}. What is not printed yet is grey.`);
    } catch (error) {
      setText(text, error.message);
    }
  };
  return { element, show };
}
