/**
 * The part of the bed that a picture of a layer shows.
 */

const BORDER = 16; // px around the print
const MAX_SCALE = 2000; // px per mm
const MIN_SCALE = 0.05;

/**
 * Which part of the bed is visible: its centre, mm, and px per mm. y points up on the bed and down in the picture.
 */
export class FlatWindow {
  /** @param {{low: number[], high: number[]}} bounds of the print, mm */
  constructor(bounds) {
    this.bounds = bounds;
    this.resize(1, 1);
    this.fit();
  }

  /** Take a new size of the picture, px. */
  resize(width, height) {
    this.width = width;
    this.height = height;
    if (this.isFitted) this.fit();
  }

  /** Show the whole print. */
  fit() {
    const { low, high } = this.bounds;
    this.x = (low[0] + high[0]) / 2;
    this.y = (low[1] + high[1]) / 2;
    const across = (this.width - 2 * BORDER) / Math.max(high[0] - low[0], 1);
    const up = (this.height - 2 * BORDER) / Math.max(high[1] - low[1], 1);
    this.scale = Math.max(Math.min(across, up), MIN_SCALE);
    this.isFitted = true;
  }

  /** Move the picture by px. */
  pan(right, down) {
    this.x -= right / this.scale;
    this.y += down / this.scale;
    this.isFitted = false;
  }

  /** Enlarge the picture by a factor; the place at (left, top), px, stays where it is. */
  zoom(factor, left = this.width / 2, top = this.height / 2) {
    const [x, y] = this.toBed(left, top);
    this.scale = Math.max(MIN_SCALE, Math.min(this.scale * factor, MAX_SCALE));
    const [newX, newY] = this.toBed(left, top);
    this.x += x - newX;
    this.y += y - newY;
    this.isFitted = false;
  }

  /** Return the place on the bed, mm, of a place in the picture, px. */
  toBed(left, top) {
    return [this.x + (left - this.width / 2) / this.scale, this.y - (top - this.height / 2) / this.scale];
  }
}
