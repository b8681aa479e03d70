/**
 * The picture of a webcam, which the browser loads itself.
 */
import { make, setShown } from "./elements.js";
import { request } from "./requests.js";

let printers = /** @type {Promise<any[]> | null} */ (null);

/**
 * Return the picture of a printer; it is loaded while it is unfolded.
 *
 * @param {string} printer
 */
export function makeWebcam(printer) {
  const element = make("details", { hidden: true }, make("summary", {}, "Webcam"));
  const begin = async () => {
    const found = (await listPrinters()).find((one) => one.name === printer);
    if (!found?.webcam) return;
    const image = make("img", { class: "webcam", alt: `Webcam of ${printer}` });
    let timer = 0;
    const load = () => {
      const address = new URL(found.webcam);
      if (found.webcam_interval) address.searchParams.set("time", String(Date.now()));
      image.src = address.href;
    };
    element.addEventListener("toggle", () => {
      clearInterval(timer);
      if (!element.open) return image.removeAttribute("src"); // ends the stream
      load();
      if (found.webcam_interval) timer = setInterval(load, 1000 * found.webcam_interval);
    });
    element.append(image);
    setShown(element, true);
  };
  begin();
  return element;
}

/** Return what the server says of the printers, asked once. */
function listPrinters() {
  printers ??= request("GET", "/v1/printers").catch(() => []);
  return printers;
}
