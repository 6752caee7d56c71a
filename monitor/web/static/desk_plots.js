// Drawings of the import desk: a second of signal, its spectrum with the first fault lines, dates on a line.

import { ticks } from "./canvas.js";
import { h } from "./dom.js";
import * as fmt from "./fmt.js";

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 440;
const HEIGHT = 156;
const LEFT = 44;
const BOTTOM = 28;

function shape(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** An area between lowest and highest values over an axis that begins at 0, with round numbers at both axes. */
function plot(curve, step, [low, high], label, xUnit, yUnit) {
  const n = curve.high.length;
  const length = step * n;
  const x = (value) => LEFT + (value / length) * (WIDTH - LEFT - 6);
  const y = (value) => 8 + ((high - value) / (high - low || 1)) * (HEIGHT - BOTTOM - 8);
  const up = curve.high.map((value, i) => `${x((i + 0.5) * step).toFixed(1)},${y(value ?? 0).toFixed(1)}`);
  const down = curve.low.map((value, i) => `${x((i + 0.5) * step).toFixed(1)},${y(value ?? 0).toFixed(1)}`).reverse();
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label, class: "desk-plot" });
  for (const tick of ticks(low, high, 4)) {
    svg.append(shape("line", { class: "grid", x1: LEFT, x2: WIDTH - 6, y1: y(tick), y2: y(tick) }));
    svg.append(shape("text", { class: "axis end", x: LEFT - 5, y: y(tick) + 4 }, fmt.number(tick)));
  }
  for (const tick of ticks(0, length, 5).filter((value) => value < 0.92 * length)) svg.append(shape("text", { class: "axis middle", x: x(tick), y: HEIGHT - 8 }, fmt.number(tick)));
  svg.append(shape("polygon", { class: "area", points: [...up, ...down].join(" ") }));
  svg.append(shape("text", { class: "axis", x: 2, y: 12 }, yUnit), shape("text", { class: "axis end", x: WIDTH - 4, y: HEIGHT - 8 }, xUnit));
  return { svg, x };
}

const figure = (caption, svg) => h("figure", null, h("figcaption", { class: "note" }, caption), svg);

export function signalPlot(channel) {
  const { low, high, step_s: step } = channel.signal;
  const ends = [Math.min(...low), Math.max(...high)];
  const { svg } = plot(channel.signal, step, ends, `Signal of ${channel.name}, from ${fmt.number(ends[0])} to ${fmt.number(ends[1])} ${channel.unit}`, "s", channel.unit);
  return figure("The first second", svg);
}

export function spectrumPlot(channel) {
  const { high, step_hz: step } = channel.spectrum;
  const most = Math.max(...high) || 1;
  const at = high.indexOf(Math.max(...high));
  const { svg, x } = plot(channel.spectrum, step, [0, most], `Spectrum of ${channel.name}, highest at about ${fmt.number((at + 0.5) * step)} Hz`, "Hz", channel.unit);
  for (const [part, lines] of Object.entries(channel.lines_hz))
    for (const line of lines)
      if (line < step * high.length) svg.append(shape("line", { class: "fault", "data-part": part, x1: x(line), x2: x(line), y1: HEIGHT - BOTTOM + 1, y2: HEIGHT - BOTTOM + 8 }));
  return figure(Object.keys(channel.lines_hz).length ? "Spectrum; marks: first five lines of each part" : "Spectrum", svg);
}

/** The starts of files as marks on a line. */
export function dateLine(dates) {
  const known = dates.filter((date) => fmt.isNumber(date.time_s));
  if (known.length < 1) return h("p", { class: "note" }, "No file has a date.");
  const times = known.map((date) => date.time_s);
  const [first, last] = [Math.min(...times), Math.max(...times)];
  const words = (time) => fmt.moment(time, { dated: true, zone: "UTC" });
  const label = first === last ? `One date: ${words(first)}` : `${fmt.counted(known.length, "date")} from ${words(first)} to ${words(last)}`;
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} 24`, role: "img", "aria-label": label, class: "desk-plot dates", preserveAspectRatio: "none" });
  const x = (time) => 6 + ((time - first) / (last - first || 1)) * (WIDTH - 12);
  svg.append(shape("line", { class: "grid", x1: 6, x2: WIDTH - 6, y1: 12, y2: 12 }));
  for (const time of times) svg.append(shape("line", { class: "date", x1: x(time), x2: x(time), y1: 4, y2: 20 }));
  return figure(label, svg);
}
