/**
 * The picture of a webcam, which the browser loads itself.
 */
import { make, setShown } from "./elements.js";

/**
 * Return the picture of a printer; it is loaded while it is unfolded.
 *
 * @param {{name: string, webcam: string, webcam_interval: number}} printer
 */
export function makeWebcam({ name, webcam, webcam_interval: interval }) {
  const image = make("img", { class: "webcam", alt: `Webcam of ${name}` });
  let timer = 0;
  const load = () => {
    const address = new URL(webcam);
    if (interval) address.searchParams.set("time", String(Date.now()));
    image.src = address.href;
  };
  const change = () => {
    clearInterval(timer);
    if (!element.open) return image.removeAttribute("src"); // ends the stream
    load();
    if (interval) timer = setInterval(load, 1000 * interval);
  };
  const element = make("details", { ontoggle: change }, make("summary", {}, "Webcam"), ...(webcam ? [image] : []));
  setShown(element, webcam !== "");
  return element;
}
