/**
 * A chart of the temperatures of a printer: full lines are measured, dashed ones are targets.
 */
import { prepareCanvas } from "./canvas.js";
import { make } from "./elements.js";
import { HISTORY_LENGTH, getTemperatures, nameHeater } from "./temperature_history.js";

const HEIGHT = 120; // px
const LEFT = 34; // px for the figures at the side
const BELOW = 18; // px for the times
const LENGTHS = [6, 15, 30, 60, 180, 720, HISTORY_LENGTH / 60]; // min
const GAP = 90; // s without a sample, after which the line is interrupted

/**
 * Return a chart.
 *
 * @param {string} printer
 * @returns {{element: HTMLElement, show: () => void}}
 */
export function makeTemperatureChart(printer) {
  const canvas = make("canvas", { class: "chart", role: "img" });
  let last = "";
  const show = () => {
    const samples = getTemperatures(printer);
    const newest = samples.at(-1)?.time ?? 0;
    const key = `${samples.length} ${newest} ` + canvas.clientWidth + document.documentElement.dataset.scheme;
    if (key === last || !canvas.clientWidth) return;
    last = key;
    canvas.setAttribute("aria-label", describe(samples));
    draw(canvas, samples);
  };
  new ResizeObserver(show).observe(canvas);
  return { element: canvas, show };
}

/** Return the newest temperatures as text. */
function describe(samples) {
  const now = Object.entries(samples.at(-1)?.temperatures ?? {});
  const values = now.map(([heater, [actual, target]]) => `${nameHeater(heater)} ${actual.toFixed(0)} of ${target.toFixed(0)} °C`);
  return `Temperatures; now ${values.join(", ") || "unknown"}`;
}

/** Draw all samples. */
function draw(canvas, samples) {
  const { width, context } = prepareCanvas(canvas, HEIGHT);
  const colours = getComputedStyle(canvas);
  const end = samples.at(-1)?.time ?? 0;
  const minutes = LENGTHS.find((one) => end - (samples[0]?.time ?? end) <= 60 * one) ?? LENGTHS.at(-1);
  const all = samples.flatMap((sample) => Object.values(sample.temperatures).flat());
  const top = Math.max(50, Math.ceil(Math.max(...all, 0) / 50) * 50);
  const placeX = (time) => LEFT + (width - LEFT) * (1 - (end - time) / (60 * minutes));
  const placeY = (value) => 6 + (HEIGHT - BELOW - 6) * (1 - value / top);
  drawGrid(context, colours, { width, top, minutes, placeY });
  const heaters = Object.keys(samples.at(-1)?.temperatures ?? {});
  heaters.forEach((heater, number) => {
    context.strokeStyle = colours.getPropertyValue(`--heater-${(number % 3) + 1}`);
    for (const [index, dashes, thickness] of [[1, [3, 3], 1], [0, [], 2]]) {
      context.setLineDash(dashes);
      context.lineWidth = thickness;
      drawLine(context, samples, (sample) => sample.temperatures[heater]?.[index], placeX, placeY);
    }
  });
}

/** Draw horizontal lines with their temperatures, and the times below. */
function drawGrid(context, colours, { width, top, minutes, placeY }) {
  context.font = `12px ${colours.fontFamily}`;
  context.fillStyle = colours.getPropertyValue("--muted");
  context.strokeStyle = colours.getPropertyValue("--faint");
  context.lineWidth = 1;
  for (let value = 0; value <= top; value += top > 150 ? 100 : 50) {
    context.beginPath();
    context.moveTo(LEFT, placeY(value));
    context.lineTo(width, placeY(value));
    context.stroke();
    context.textAlign = "right";
    context.fillText(`${value}°`, LEFT - 4, placeY(value) + 4);
  }
  for (const third of [0, 1, 2, 3]) {
    context.textAlign = third % 3 ? "center" : ["left", "right"][third / 3];
    const before = minutes - (third * minutes) / 3;
    const text = third === 3 ? "now" : before < 90 ? `−${before} min` : `−${before / 60} h`;
    context.fillText(text, LEFT + ((width - LEFT) * third) / 3, HEIGHT - 3);
  }
}

/** Draw one line through the samples. */
function drawLine(context, samples, getValue, placeX, placeY) {
  context.beginPath();
  let before = -Infinity;
  for (const sample of samples) {
    const value = getValue(sample);
    if (value === undefined) continue;
    if (sample.time - before > GAP) context.moveTo(placeX(sample.time), placeY(value));
    else context.lineTo(placeX(sample.time), placeY(value));
    before = sample.time;
  }
  context.stroke();
}
