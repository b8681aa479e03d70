/**
 * A picture of one layer from above: what is printed in the colours of its roles, the rest in grey.
 */
import { prepareCanvas } from "./canvas.js";
import { make } from "./elements.js";
import { FlatWindow } from "./flat_window.js";
import { drawLayer } from "./layer_view.js";
import { endOfLayer } from "./preview.js";

const SHAPE = 0.75; // of the picture: height by width
const MAX_HEIGHT = 420; // px

/**
 * Return the picture.
 *
 * @returns {{element: HTMLCanvasElement, show: (loaded: any, layer: number, share: number, label: string) => void}}
 *   `show` draws a layer of a loaded preview, of which a share is printed
 */
export function makeLayerPicture() {
  const canvas = make("canvas", { class: "layer", role: "img" });
  let last = () => {};
  let drawn = "";
  const show = (loaded, layer, share, label) => {
    last = () => show(loaded, layer, share, label);
    const { preview, bounds } = loaded;
    const first = preview.layers.first[layer];
    const end = Math.round(first + share * (endOfLayer(preview, layer) - first));
    const height = Math.min(MAX_HEIGHT, Math.round(SHAPE * canvas.clientWidth));
    const key = [preview.name, preview.moves, layer, end, height, document.documentElement.dataset.scheme].join("\n");
    if (!height || key === drawn) return;
    drawn = key;
    canvas.style.height = `${height}px`;
    canvas.setAttribute("aria-label", label);
    drawPicture(canvas, height, { preview, bounds, layer, end });
  };
  new ResizeObserver(() => last()).observe(canvas);
  return { element: canvas, show };
}

/** Draw a layer up to a move. */
function drawPicture(canvas, height, { preview, bounds, layer, end }) {
  const { width, context } = prepareCanvas(canvas, height);
  const view = new FlatWindow(bounds);
  view.resize(width, height);
  const colours = getComputedStyle(canvas);
  const ink = { faint: colours.getPropertyValue("--panel"), rest: colours.getPropertyValue("--faint"), seam: "" };
  const colouring = { index: preview.role, palette: preview.roles.map((role) => role.colour), legend: [], unit: "" };
  drawLayer(context, preview, view, { layer, end, colouring, ink, travels: false, retractions: false, seams: false });
}
