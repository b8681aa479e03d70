/**
 * Draw all layers with WebGL2: at once a coarse picture, and after a rest every move, some in each frame.
 */
import { chooseCoarseMoves, lowerIndex } from "./coarse_moves.js";
import { RibbonProgram } from "./ribbon_program.js";

/**
 * @typedef {Object} SolidPicture what to draw
 * @property {number} begin first move
 * @property {number} end first move that is not drawn
 * @property {boolean} travels
 */

const MAX_COARSE_MOVES = 20_000;
const MIN_COARSE_MOVES = 2_000;
const FIRST_SLICE = 30_000; // moves in a frame; grows and shrinks with the time that the last ones took
const MIN_SLICE = 2_000;
const REST = 200; // ms without a change before every move is drawn
const SLOW_FRAME = 60; // ms
const FAST_FRAME = 20; // ms

/** The picture of all layers on one canvas. */
export class SolidView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./preview.js").Preview} preview
   * @param {import("./orbit_camera.js").OrbitCamera} camera
   * @throws {Error} if the browser has no WebGL2
   */
  constructor(canvas, preview, camera) {
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser does not offer WebGL2.");
    this.canvas = canvas;
    this.gl = gl;
    this.preview = preview;
    this.camera = camera;
    this.program = new RibbonProgram(gl, preview);
    const points = this.program.upload(preview.points);
    this.all = { begin: points, end: points, endOffset: 6, size: this.program.upload(preview.sizes), colour: null };
    this.slice = FIRST_SLICE;
    this.coarseLimit = MAX_COARSE_MOVES;
    this.chooseCoarse();
  }

  /** @param {import("./colouring.js").Colouring} colouring */
  setColouring(colouring) {
    this.colouring = colouring;
    this.gl.deleteBuffer(this.all.colour);
    this.all.colour = this.program.upload(colouring.index);
    this.program.setPalette(colouring.palette);
    this.colourCoarse();
  }

  /** @param {SolidPicture} picture */
  draw(picture) {
    this.picture = picture;
    this.cancel();
    this.drawCoarse();
    this.timer = setTimeout(() => this.startFull(), REST);
  }

  /** Stop drawing. */
  cancel() {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.frame);
    if (this.target) this.releaseTarget();
  }

  chooseCoarse() {
    const { preview, program, gl } = this;
    if (this.coarse) for (const name of ["begin", "end", "size", "colour"]) gl.deleteBuffer(this.coarse[name]);
    const { moves, layers } = chooseCoarseMoves(preview, this.coarseLimit);
    const gather = (values, width, shift) => {
      const result = new Uint16Array(width * moves.length);
      moves.forEach((move, row) => {
        const at = width * (move + shift);
        for (let column = 0; column < width; column += 1) result[width * row + column] = values[at + column];
      });
      return program.upload(result);
    };
    this.coarse = {
      moves,
      layers,
      begin: gather(preview.points, 3, 0),
      end: gather(preview.points, 3, 1),
      endOffset: 0,
      size: gather(preview.sizes, 2, 0),
      colour: null,
    };
    if (this.colouring) this.colourCoarse();
  }

  colourCoarse() {
    const { moves } = this.coarse;
    this.gl.deleteBuffer(this.coarse.colour);
    this.coarse.colour = this.program.upload(Uint8Array.from(moves, (move) => this.colouring.index[move]));
  }

  drawCoarse() {
    const { coarse, picture } = this;
    this.prepare();
    const first = lowerIndex(coarse.moves, picture.begin);
    const last = lowerIndex(coarse.moves, picture.end);
    this.program.draw(coarse, first, last - first, coarse.layers);
    this.tell(last - first, false);
    this.watch((milliseconds) => {
      if (milliseconds < 4 * SLOW_FRAME || this.coarseLimit <= MIN_COARSE_MOVES) return;
      this.coarseLimit = Math.max(MIN_COARSE_MOVES, this.coarseLimit / 2);
      this.chooseCoarse();
    });
  }

  /** Clear the picture and set the view. */
  prepare() {
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.program.look(this.camera, this.picture.travels);
  }

  /** Draw every move into a picture that replaces the coarse one when it is complete. */
  startFull() {
    const { gl, canvas } = this;
    this.target = gl.createFramebuffer();
    this.storage = [gl.RGBA8, gl.DEPTH_COMPONENT24].map((format) => {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, canvas.width, canvas.height);
      return buffer;
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.storage[0]);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.storage[1]);
    this.prepare();
    this.continueFull(this.picture.begin);
  }

  continueFull(begin) {
    const { picture, slice } = this;
    const end = Math.min(begin + slice, picture.end);
    this.program.draw(this.all, begin, end - begin, 1);
    this.watch((milliseconds) => {
      if (milliseconds > SLOW_FRAME) this.slice = Math.max(MIN_SLICE, slice / 2);
      if (milliseconds < FAST_FRAME) this.slice = 2 * slice;
      if (end < picture.end) this.continueFull(end);
      else this.finishFull();
    });
  }

  finishFull() {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.target);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const { width, height } = canvas;
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    this.releaseTarget();
    this.tell(this.picture.end - this.picture.begin, true);
  }

  /** Let the page and its tests know how many moves the picture has, and whether these are all. */
  tell(moves, isComplete) {
    this.canvas.dataset.moves = String(moves);
    this.canvas.dataset.complete = String(isComplete);
  }

  releaseTarget() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(this.target);
    for (const buffer of this.storage) gl.deleteRenderbuffer(buffer);
    this.target = null;
  }

  /**
   * Call back in the first frame in which the graphics processor has drawn what it was told, with the time it took.
   *
   * @param {(milliseconds: number) => void} done
   */
  watch(done) {
    const { gl } = this;
    const begin = performance.now();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED) {
        gl.deleteSync(fence);
        done(performance.now() - begin);
      } else {
        this.frame = requestAnimationFrame(look);
      }
    };
    this.frame = requestAnimationFrame(look);
  }
}
