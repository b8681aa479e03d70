/**
 * The controls beside the picture, and the legend.
 */
import { COLOUR_MODES } from "./colouring.js";
import { describeLayer } from "./descriptions.js";
import { make, makeCheckbox, makeSlider } from "./elements.js";
import { DERETRACTION, RETRACTION, TRAVEL } from "./preview.js";
import { movesOfLayer } from "./selection.js";

/**
 * @typedef {Object} ControlActions
 * @property {(change: Partial<import("./selection.js").Selection>) => void} change
 * @property {() => void} play start or stop
 */

const SHORTCUTS =
  "Keys: up and down change the layer, left and right the move, + and - zoom, 0 shows all, space plays, " +
  "1 to 6 choose the colours, V changes the view.";
const VIEWS = [["layer", "One layer"], ["solid", "All layers in 3D"]];

/**
 * Return the controls and a function that shows a selection in them.
 *
 * @param {import("./preview.js").Preview} preview
 * @param {ControlActions} actions
 */
export function makeControls(preview, actions) {
  const { change } = actions;
  const view = makeChoice("View", VIEWS, (value) => change({ view: value }));
  const mode = makeColourMenu(change);
  const layer = makeSlider("layer", "Layer", (value) => change({ layer: value }));
  const bottom = makeSlider("bottom", "Lowest layer in 3D", (value) => change({ bottom: value }));
  const moves = makeSlider("moves", "Moves", (value) => change({ shown: value }));
  const play = make("button", { type: "button", onclick: actions.play }, "Play");
  const legend = make("ul", { class: "legend", "aria-label": "Legend" });
  const boxes = makeVisibility(change);
  const element = make(
    "div",
    { class: "controls" },
    view.row,
    layer.row,
    bottom.row,
    moves.row,
    make("div", { class: "buttons" }, play),
    mode.row,
    legend,
    boxes.row,
    make("p", { class: "hint" }, SHORTCUTS),
  );
  const show = (selection, colouring, isPlaying) => {
    const top = preview.layers.first.length - 1;
    const most = movesOfLayer(preview, selection.layer);
    const isLayer = selection.view === "layer";
    view.show(selection.view);
    mode.show(selection.mode);
    boxes.show(selection);
    layer.show(selection.layer, top, describeLayer(preview, selection.layer));
    bottom.row.hidden = isLayer;
    bottom.show(selection.bottom, top, String(selection.bottom + 1), isLayer);
    moves.show(selection.shown, most, `${selection.shown} of ${most}`);
    play.textContent = isPlaying ? "Pause" : "Play";
    showLegend(legend, preview, selection, colouring);
  };
  return { element, show };
}

/** Return radio buttons of which one is chosen. */
function makeChoice(name, options, change) {
  const inputs = options.map(([value]) =>
    make("input", { type: "radio", name, value, onchange: () => change(value) }),
  );
  const labels = options.map(([, label], number) => make("label", { class: "choice" }, inputs[number], label));
  const row = make("fieldset", {}, make("legend", {}, name), ...labels);
  return {
    row,
    show(value) {
      for (const input of inputs) input.checked = input.value === value;
    },
  };
}

function makeColourMenu(change) {
  const options = COLOUR_MODES.map(({ id, label }, number) => make("option", { value: id }, `${number + 1} ${label}`));
  /** @type {HTMLSelectElement} */
  const select = make("select", { id: "mode", onchange: () => change({ mode: select.value }) }, ...options);
  return {
    row: make("div", { class: "menu" }, make("label", { for: "mode" }, "Colours"), select),
    show(mode) {
      select.value = mode;
    },
  };
}

function makeVisibility(change) {
  const names = [["travels", "Travels"], ["retractions", "Retractions"], ["seams", "Seams"]];
  const boxes = names.map(([name, label]) => makeCheckbox(label, false, (checked) => change({ [name]: checked })));
  return {
    row: make("fieldset", {}, make("legend", {}, "Also show"), ...boxes),
    show(selection) {
      names.forEach(([name], number) => {
        const input = boxes[number].querySelector("input");
        input.checked = selection[name];
        // Marks belong to the picture of one layer.
        boxes[number].hidden = name !== "travels" && selection.view === "solid";
      });
    },
  };
}

/** Show the colours of extrusions and of what else is shown. */
function showLegend(legend, preview, selection, colouring) {
  const entries = colouring.legend.map(({ label, colour }) => ({
    label: colouring.unit ? `${label} ${colouring.unit}` : label,
    colour,
  }));
  const shown = [];
  if (selection.travels) shown.push(TRAVEL);
  if (selection.retractions && selection.view === "layer") shown.push(RETRACTION, DERETRACTION);
  for (const role of shown) entries.push({ label: preview.roles[role].name, colour: preview.roles[role].colour });
  if (selection.seams && selection.view === "layer") entries.push({ label: "Seam", colour: "" });
  legend.replaceChildren(
    ...entries.map(({ label, colour }) => {
      const swatch = make("span", { class: colour ? "swatch" : "swatch seam", "aria-hidden": "true" });
      if (colour) swatch.style.backgroundColor = colour;
      return make("li", {}, swatch, label);
    }),
  );
}
