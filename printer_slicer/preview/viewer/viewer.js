/**
 * The viewer: a picture of the print and its controls.
 */
import { colourMoves } from "./colouring.js";
import { makeControls } from "./controls.js";
import { describeMove, describePrint } from "./descriptions.js";
import { make } from "./elements.js";
import { FlatWindow } from "./flat_window.js";
import { listenToKeys } from "./keyboard.js";
import { drawLayer, findMove } from "./layer_view.js";
import { OrbitCamera } from "./orbit_camera.js";
import { listenToPointers } from "./pointer_input.js";
import { boundsOfPrint } from "./preview.js";
import { changeSelection, firstSelection, movesOfLayer, stepMoves } from "./selection.js";
import { SolidView } from "./solid_view.js";

const LAYER_SECONDS = 4; // of a layer when playing
const REACH = 8; // px around the pointer in which a move is found
const BUTTON_ZOOM = 1.25;

/**
 * Show a preview in an element.
 *
 * @param {HTMLElement} root
 * @param {import("./preview.js").Preview} preview
 * @returns {Promise<Viewer>}
 */
export async function startViewer(root, preview) {
  const selection = firstSelection(preview);
  const colouring = await colourMoves(preview, selection.mode);
  return new Viewer(root, preview, { selection, colouring, bounds: await boundsOfPrint(preview) });
}

/** The state of a viewer: what is selected, and from where it is seen. */
class Viewer {
  /**
   * @param {HTMLElement} root
   * @param {import("./preview.js").Preview} preview
   * @param {{selection: import("./selection.js").Selection, colouring: import("./colouring.js").Colouring,
   *   bounds: {low: number[], high: number[]}}} first what is shown first
   */
  constructor(root, preview, { selection, colouring, bounds }) {
    this.preview = preview;
    this.selection = selection;
    this.colouring = colouring;
    /** @type {SolidView | null} made when it is first shown */
    this.solidView = null;
    /** @type {number | null} the frame in which the picture will be drawn */
    this.frame = null;
    this.isPlaying = false;
    this.window = new FlatWindow(bounds);
    this.camera = new OrbitCamera(bounds);
    this.hovered = -1;
    this.build(root);
    this.listen(root);
    this.resize();
  }

  /** Put the elements into the page. */
  build(root) {
    const { preview } = this;
    this.flat = make("canvas", { class: "picture", tabIndex: 0, role: "img" });
    this.solid = make("canvas", { class: "picture", tabIndex: 0, role: "img", hidden: true });
    this.details = make("p", { class: "details", "aria-live": "polite" });
    this.message = make("p", { class: "message", role: "alert", hidden: true });
    this.controls = makeControls(preview, {
      change: (change) => this.change(change),
      play: () => this.play(),
    });
    const zoomButton = (label, text, action) =>
      make("button", { type: "button", "aria-label": label, title: label, onclick: action }, text);
    const zooms = make(
      "div",
      { class: "zooms" },
      zoomButton("Zoom in", "+", () => this.zoom(BUTTON_ZOOM)),
      zoomButton("Zoom out", "−", () => this.zoom(1 / BUTTON_ZOOM)),
      zoomButton("Show all", "⤢", () => this.fit()),
    );
    this.stage = make("div", { class: "stage" }, this.flat, this.solid, zooms);
    const head = make("header", {}, make("h1", {}, preview.name || "Print"), make("p", {}, describePrint(preview)));
    root.classList.add("viewer");
    root.replaceChildren(head, this.stage, this.details, this.message, this.controls.element);
  }

  listen(root) {
    listenToKeys(root.ownerDocument.body, {
      stepLayers: (layers) => this.change({ layer: this.selection.layer + layers }),
      stepMoves: (moves) => this.change(stepMoves(this.preview, this.selection, moves)),
      zoom: (factor) => this.zoom(factor),
      fit: () => this.fit(),
      play: () => this.play(),
      changeView: () => this.change({ view: this.selection.view === "layer" ? "solid" : "layer" }),
      colour: (mode) => this.change({ mode }),
    });
    listenToPointers(this.flat, {
      drag: (right, down) => this.look(() => this.window.pan(right, down)),
      zoom: (factor, left, top) => this.look(() => this.window.zoom(factor, left, top)),
      hover: (left, top) => this.hover(left, top),
      leave: () => this.point(-1),
    });
    listenToPointers(this.solid, {
      drag: (right, down, isSecond) =>
        this.look(() => (isSecond ? this.camera.pan(right, down) : this.camera.turn(right, down))),
      zoom: (factor) => this.look(() => this.camera.zoom(factor)),
      hover: () => {},
      leave: () => {},
    });
    new ResizeObserver(() => this.resize()).observe(this.stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.render());
  }

  /** Change what is shown. */
  change(change) {
    const { mode } = this.selection;
    this.selection = changeSelection(this.preview, this.selection, change);
    this.hovered = -1;
    if (this.selection.mode !== mode) this.recolour(this.selection.mode);
    this.render();
  }

  async recolour(mode) {
    const colouring = await colourMoves(this.preview, mode);
    if (this.selection.mode !== mode) return; // another one was chosen in the meantime
    this.colouring = colouring;
    this.stage.dataset.colours = mode;
    this.solidView?.setColouring(colouring);
    this.render();
  }

  /** Change from where the print is seen. */
  look(change) {
    change();
    this.render();
  }

  zoom(factor) {
    this.look(() => (this.selection.view === "layer" ? this.window.zoom(factor) : this.camera.zoom(factor)));
  }

  fit() {
    this.look(() => (this.selection.view === "layer" ? this.window.fit() : this.camera.fit()));
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    for (const canvas of [this.flat, this.solid]) {
      canvas.width = Math.round(width * devicePixelRatio);
      canvas.height = Math.round(height * devicePixelRatio);
    }
    this.window.resize(width, height);
    this.camera.resize(width, height);
    this.render();
  }

  hover(left, top) {
    const reach = REACH / this.window.scale;
    this.point(findMove(this.preview, this.layerPicture(), this.window.toBed(left, top), reach));
  }

  /** Tell what a move is; -1 tells what the last move is that is shown. */
  point(move) {
    this.hovered = move;
    this.showDetails();
  }

  /** Play the moves layer by layer, or stop. */
  play() {
    this.isPlaying = !this.isPlaying;
    if (this.isPlaying) {
      const { layer, shown } = this.selection;
      if (shown === movesOfLayer(this.preview, layer)) this.change({ shown: 1 });
      let last = performance.now();
      const step = (now) => {
        if (!this.isPlaying) return;
        this.advance((now - last) / 1000);
        last = now;
        requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    }
    this.render();
  }

  advance(seconds) {
    const { layer, shown } = this.selection;
    const most = movesOfLayer(this.preview, layer);
    const moves = Math.max(1, Math.round((most * seconds) / LAYER_SECONDS));
    if (shown < most) this.change({ shown: Math.min(shown + moves, most) });
    else if (layer + 1 < this.preview.layers.first.length) this.change({ layer: layer + 1, shown: 1 });
    else this.play();
  }

  /** Draw in the next frame. */
  render() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      const isLayer = this.selection.view === "layer";
      this.flat.hidden = !isLayer;
      this.solid.hidden = isLayer;
      this.controls.show(this.selection, this.colouring, this.isPlaying);
      this.showDetails();
      if (isLayer) this.drawFlat();
      else this.drawSolid();
    });
  }

  layerPicture() {
    const { layer, shown, travels, retractions, seams } = this.selection;
    const style = getComputedStyle(this.stage);
    return {
      layer,
      end: this.preview.layers.first[layer] + shown,
      colouring: this.colouring,
      travels,
      retractions,
      seams,
      ink: { faint: style.getPropertyValue("--faint").trim(), seam: style.getPropertyValue("--ink").trim() },
    };
  }

  drawFlat() {
    this.solidView?.cancel();
    const context = this.flat.getContext("2d");
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    drawLayer(context, this.preview, this.window, this.layerPicture());
  }

  drawSolid() {
    const { layers } = this.preview;
    const { bottom, layer, shown, travels } = this.selection;
    try {
      this.solidView ??= this.makeSolidView();
    } catch (error) {
      this.message.hidden = false;
      this.message.textContent = `${error.message} The picture of one layer works without it.`;
      this.change({ view: "layer" });
      return;
    }
    this.solidView.draw({ begin: layers.first[bottom], end: layers.first[layer] + shown, travels });
  }

  makeSolidView() {
    const view = new SolidView(this.solid, this.preview, this.camera);
    view.setColouring(this.colouring);
    return view;
  }

  showDetails() {
    const { layer, shown } = this.selection;
    const last = this.preview.layers.first[layer] + shown - 1;
    const text = describeMove(this.preview, this.hovered >= 0 ? this.hovered : last);
    this.details.textContent = text;
    // Screen readers are told what keys choose, not all that the mouse passes.
    this.details.setAttribute("aria-live", this.hovered >= 0 ? "off" : "polite");
    const label = `Layer ${layer + 1} of ${this.preview.layers.first.length}. Move: ${text}`;
    for (const canvas of [this.flat, this.solid]) canvas.setAttribute("aria-label", label);
  }
}
