/**
 * Start the viewer in a file that contains the preview.
 */
import { decodePreview, pause } from "./preview.js";
import { startViewer } from "./viewer.js";

const CHARACTERS_PER_TASK = 1 << 18; // a multiple of 4

/**
 * Return the preview that an element holds as gzip in base64, and remove the text.
 *
 * @param {HTMLElement} element
 * @returns {Promise<ArrayBuffer>}
 */
async function readEmbeddedPreview(element) {
  const text = element.textContent.trim();
  element.remove();
  const parts = [];
  for (let begin = 0; begin < text.length; begin += CHARACTERS_PER_TASK) {
    const binary = atob(text.slice(begin, begin + CHARACTERS_PER_TASK));
    const part = new Uint8Array(binary.length);
    for (let index = 0; index < part.length; index += 1) part[index] = binary.charCodeAt(index);
    parts.push(part);
    await pause();
  }
  const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

async function startPage() {
  const root = document.getElementById("viewer");
  try {
    const buffer = await readEmbeddedPreview(document.getElementById("preview"));
    await startViewer(root, await decodePreview(buffer));
  } catch (error) {
    root.textContent = `The preview cannot be shown. ${error.message}`;
  }
}

startPage();
