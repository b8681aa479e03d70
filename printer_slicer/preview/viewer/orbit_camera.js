/**
 * A camera that turns around the print, without perspective.
 */

const MIN_PITCH = 0.02;
const MAX_PITCH = Math.PI / 2;
const MARGIN = 1.08;

/**
 * The direction from which the print is seen: yaw and pitch in radians; the point in the middle, mm; and the height of
 * the picture, mm.
 */
export class OrbitCamera {
  /** @param {{low: number[], high: number[]}} bounds of the print, mm */
  constructor(bounds) {
    this.bounds = bounds;
    this.yaw = 0.6;
    this.pitch = 0.5;
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
    this.centre = low.map((value, axis) => (value + high[axis]) / 2);
    const sides = low.map((value, axis) => Math.max(high[axis] - value, 1));
    const [right, up] = this.axes();
    const reach = (direction) => direction.reduce((sum, part, axis) => sum + Math.abs(part) * sides[axis], 0);
    this.tall = MARGIN * Math.max(reach(up), (reach(right) * this.height) / this.width);
    this.isFitted = true;
  }

  /** Turn the print by px. */
  turn(right, down) {
    this.yaw -= right / 150;
    this.pitch = Math.max(MIN_PITCH, Math.min(this.pitch + down / 150, MAX_PITCH));
  }

  /** Move the picture by px. */
  pan(right, down) {
    const [across, up] = this.axes();
    const perPx = this.tall / this.height;
    this.centre = this.centre.map((value, axis) => value + perPx * (down * up[axis] - right * across[axis]));
    this.isFitted = false;
  }

  /** Enlarge the picture by a factor. */
  zoom(factor) {
    this.tall = Math.max(0.5, Math.min(this.tall / factor, 1e5));
    this.isFitted = false;
  }

  /** Return the directions, in the space of the print, of right and up in the picture, and of the way to the camera. */
  axes() {
    const [sine, cosine] = [Math.sin(this.yaw), Math.cos(this.yaw)];
    const [rise, run] = [Math.sin(this.pitch), Math.cos(this.pitch)];
    return [
      [cosine, sine, 0],
      [-sine * rise, cosine * rise, run],
      [sine * run, -cosine * run, rise],
    ];
  }

  /**
   * Return the matrix from mm to the picture's coordinates of WebGL, by columns.
   *
   * @returns {Float32Array} 16 numbers
   */
  matrix() {
    const [right, up, towards] = this.axes();
    const { low, high } = this.bounds;
    const depth = Math.hypot(...low.map((value, axis) => high[axis] - value)) + this.tall + 100;
    const scales = [(2 / this.tall) * (this.height / this.width), 2 / this.tall, -1 / depth];
    const rows = [right, up, towards].map((direction, row) => direction.map((part) => part * scales[row]));
    const shifts = rows.map((row) => -row.reduce((sum, part, axis) => sum + part * this.centre[axis], 0));
    return new Float32Array([
      rows[0][0], rows[1][0], rows[2][0], 0,
      rows[0][1], rows[1][1], rows[2][1], 0,
      rows[0][2], rows[1][2], rows[2][2], 0,
      shifts[0], shifts[1], shifts[2], 1,
    ]);
  }
}
