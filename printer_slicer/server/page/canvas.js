/**
 * Canvases with the resolution of the screen.
 */

/**
 * Give a canvas the resolution of the screen, and clear it.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {number} height px of the page
 * @returns {{width: number, context: CanvasRenderingContext2D}} px of the page
 */
export function prepareCanvas(canvas, height) {
  const width = canvas.clientWidth;
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const context = canvas.getContext("2d");
  context.scale(scale, scale);
  return { width, context };
}
