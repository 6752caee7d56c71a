// What all charts share: the library, axes in the colours of the theme, lines across, and a legend with values.

import { fill, h, setText } from "./dom.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";

const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif';
export const AXIS_SIZE = 58;

let library = null;

/** Load uPlot once; it is needed by the first chart, not by the overview. */
export function loadUplot() {
  library ??= new Promise((resolve, reject) => {
    const script = h("script", { src: "static/vendor/uPlot.iife.min.js" });
    script.onload = () => resolve(globalThis.uPlot);
    script.onerror = () => reject(new Error("The charts could not be loaded."));
    document.head.append(script);
  });
  return library;
}

/** An axis in the theme's colours. */
export function axis(options) {
  return {
    stroke: colour("axis"), font: FONT, labelFont: FONT, gap: 4,
    grid: { stroke: colour("grid"), width: 1 }, ticks: { show: false }, ...options,
  };
}

export const valueAxis = (values = (u, splits) => splits.map((v) => fmt.number(v, 4))) => axis({ size: AXIS_SIZE, values, space: 28 });

/** Labels of a logarithmic axis: powers of ten, or where there is but one of them, ones, twos and fives. */
export function logLabels(splits) {
  const mantissa = (value) => Number((value / 10 ** Math.floor(Math.log10(value) + 1e-9)).toPrecision(6));
  const shown = splits.filter((value) => value > 0 && mantissa(value) === 1).length > 1 ? [1] : [1, 2, 5];
  return splits.map((value) => (value > 0 && shown.includes(mantissa(value)) ? fmt.number(value, 1) : ""));
}

/** A colour with another opacity. */
export function translucent(name, share) {
  const canvas = (translucent.canvas ??= document.createElement("canvas").getContext("2d"));
  canvas.fillStyle = colour(name) || name;
  const hex = canvas.fillStyle;
  return hex.startsWith("#") ? `${hex}${Math.round(share * 255).toString(16).padStart(2, "0")}` : hex;
}

/** Draw a vertical line with an optional label at its top. */
export function verticalLine(u, x, { stroke, dash = [], label = "", width = 1, row = 0 }) {
  const { ctx, bbox } = u;
  const at = Math.round(u.valToPos(x, "x", true)) + 0.5;
  if (!(at >= bbox.left && at <= bbox.left + bbox.width)) return;
  const scale = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width * scale;
  ctx.setLineDash(dash.map((d) => d * scale));
  ctx.beginPath();
  ctx.moveTo(at, bbox.top);
  ctx.lineTo(at, bbox.top + bbox.height);
  ctx.stroke();
  if (label) {
    ctx.font = FONT.replace("12px", `${11 * scale}px`);
    const wide = ctx.measureText(label).width + 8 * scale;
    const right = at + wide > bbox.left + bbox.width;
    ctx.fillStyle = translucent("surface", 0.85);
    const y = bbox.top + (2 + 15 * row) * scale;
    ctx.fillRect(right ? at - wide : at + scale, y, wide - scale, 14 * scale);
    ctx.fillStyle = stroke;
    ctx.textAlign = right ? "right" : "left";
    ctx.textBaseline = "top";
    ctx.fillText(label, at + (right ? -4 : 4) * scale, y + 2 * scale);
  }
  ctx.restore();
}

/** Write numbers from one above points [x, y]. */
export function numberPoints(u, points) {
  const { ctx } = u;
  const scale = devicePixelRatio;
  ctx.save();
  ctx.fillStyle = colour("text");
  ctx.font = FONT.replace("12px", `${10 * scale}px`);
  ctx.textAlign = "center";
  points.forEach(([x, y], index) => ctx.fillText(String(index + 1), u.valToPos(x, "x", true), u.valToPos(y, "y", true) - 4 * scale));
  ctx.restore();
}

/** Draw a horizontal line with a label; beyond the chart an arrow says where it lies. */
export function horizontalLine(u, y, { stroke, dash = [6, 4], label = "", taken = [], atLeft = false }) {
  const { ctx, bbox } = u;
  const scale = devicePixelRatio;
  const { min, max } = u.scales.y;
  if (!fmt.isNumber(min)) return;
  const above = y > max;
  if (y < min) return;
  const at = above ? bbox.top + 8 * scale : Math.round(u.valToPos(y, "y", true)) + 0.5;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.lineWidth = scale;
  if (!above) {
    ctx.setLineDash(dash.map((d) => d * scale));
    ctx.beginPath();
    ctx.moveTo(bbox.left, at);
    ctx.lineTo(bbox.left + bbox.width, at);
    ctx.stroke();
  }
  ctx.font = FONT.replace("12px", `${11 * scale}px`);
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  const words = above ? `${label} ↑` : label;
  const wide = ctx.measureText(words).width + 8 * scale;
  const middle = above ? at : Math.max(bbox.top + 7 * scale, at - 8 * scale);
  // Where another label stands already, this one stands beside it.
  const beside = taken.filter((other) => Math.abs(other.middle - middle) < 14 * scale).reduce((sum, other) => sum + other.wide, 0);
  const right = atLeft ? bbox.left + beside + wide : bbox.left + bbox.width - beside;
  taken.push({ middle, wide });
  ctx.fillStyle = translucent("surface", 0.8);
  ctx.fillRect(right - wide, middle - 7 * scale, wide, 14 * scale);
  ctx.fillStyle = stroke;
  ctx.fillText(words, right - 4 * scale, middle);
  ctx.restore();
}

/** A legend whose values follow the cursor. */
export class Legend {
  constructor(items) {
    this.items = items.map((item) => {
      const value = h("b");
      const swatch = h("i", { class: "swatch", "data-kind": item.kind ?? "line" });
      swatch.style.setProperty("--colour", `var(--${item.colour})`);
      return { ...item, value, element: h("span", { class: "item" }, swatch, item.label, " ", value) };
    });
    this.element = h("div", { class: "legend" }, this.items.map((item) => item.element));
  }

  show(texts) {
    this.items.forEach((item, index) => setText(item.value, texts[index] ?? ""));
  }
}

/** A titled box around a figure. */
export function figure(title, { note = null, tools = null, level = "h2" } = {}) {
  const id = `figure-${(figure.many = (figure.many ?? 0) + 1)}`;
  const body = h("div", { class: "figure-body" });
  const element = h(
    "section",
    { class: "card figure", "aria-labelledby": id },
    h("div", { class: "figure-head" }, h(level, { id }, title), note && h("span", { class: "note" }, note), tools),
    body,
  );
  return { element, body };
}

/** Say why there is no picture, with a way to try again where that may help. */
export function sayInstead(body, text, retry = null) {
  fill(body, h("div", { class: "instead" }, text, retry && h("button", { type: "button", onclick: retry }, "Try again")));
}

/** Call back with the width of an element whenever it changes. */
export function onWidth(element, act) {
  let last = 0;
  const observer = new ResizeObserver(([entry]) => {
    const width = Math.floor(entry.contentRect.width);
    if (width > 40 && width !== last) act((last = width));
  });
  observer.observe(element);
  return () => observer.disconnect();
}
