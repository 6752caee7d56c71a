// Pictures on a canvas with axes: for the waterfall and the map.

import { colourAt, colourTable, isDark } from "./colours.js";
import { colour } from "./prefs.js";

const FONT = "px system-ui, -apple-system, 'Segoe UI', Roboto, Arial, sans-serif";

/** Round numbers between two ends. */
export function ticks(low, high, wanted = 6) {
  const raw = (high - low) / Math.max(1, wanted);
  if (!(raw > 0)) return [];
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 2.5, 5, 10].find((factor) => factor * power >= raw);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high * (1 + 1e-9); i += 1) found.push(Number((i * step).toPrecision(12)));
  return found;
}

/** A picture of a table of shares (0 to 1; NaN is left empty), rows from top to bottom. */
export function picture(rows) {
  const height = rows.length;
  const width = rows[0]?.length ?? 0;
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, width);
  canvas.height = Math.max(1, height);
  const image = new ImageData(canvas.width, canvas.height);
  const words = new Uint32Array(image.data.buffer);
  const table = colourTable(isDark());
  for (let y = 0; y < height; y += 1)
    for (let x = 0; x < width; x += 1) {
      const share = rows[y][x];
      words[y * width + x] = Number.isFinite(share) ? table[Math.round(255 * Math.min(1, Math.max(0, share)))] : 0;
    }
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

/** A canvas with room for axes; all coordinates are CSS pixels. */
export class Board {
  constructor(label) {
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    this.canvas.className = "board";
  }

  /** Begin anew in a size; the plot lies inside the margins. */
  begin(width, height, { left = 58, right = 14, top = 8, bottom = 40 } = {}) {
    const scale = devicePixelRatio || 1;
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(height * scale);
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${height}px`;
    this.context = this.canvas.getContext("2d");
    this.context.setTransform(scale, 0, 0, scale, 0, 0);
    this.context.clearRect(0, 0, width, height);
    this.plot = { left, top, width: width - left - right, height: height - top - bottom };
    return this.context;
  }

  text(words, x, y, { align = "center", base = "middle", ink = colour("axis"), size = 12, turn = false } = {}) {
    const { context } = this;
    context.save();
    context.font = `${size}${FONT}`;
    context.fillStyle = ink;
    context.textAlign = align;
    context.textBaseline = base;
    context.translate(x, y);
    if (turn) context.rotate(-Math.PI / 2);
    context.fillText(words, 0, 0);
    context.restore();
  }

  /** Labels along the bottom: [value, text] with x(value) in pixels. */
  bottomAxis(marks, x, title) {
    const { left, top, width, height } = this.plot;
    for (const [value, words] of marks) {
      const at = x(value);
      if (at < left - 1 || at > left + width + 1) continue;
      this.line([[at, top + height], [at, top + height + 4]], colour("axis"));
      this.text(words, Math.min(at, left + width - 4), top + height + 7, { base: "top" });
    }
    this.text(title, left + width / 2, top + height + 38, { base: "bottom" });
  }

  leftAxis(marks, y, title = "") {
    const { left, top, height } = this.plot;
    for (const [value, words] of marks) {
      const at = y(value);
      if (at < top - 1 || at > top + height + 1) continue;
      this.line([[left - 4, at], [left, at]], colour("axis"));
      this.text(words, left - 7, at, { align: "right" });
    }
    if (title) this.text(title, 10, top + height / 2, { turn: true });
  }

  line(points, ink, { width = 1, dash = [] } = {}) {
    const { context } = this;
    context.save();
    context.strokeStyle = ink;
    context.lineWidth = width;
    context.lineJoin = "round";
    context.setLineDash(dash);
    context.beginPath();
    points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    context.restore();
  }

  frame() {
    const { left, top, width, height } = this.plot;
    this.context.strokeStyle = colour("line");
    this.context.lineWidth = 1;
    this.context.strokeRect(left + 0.5, top + 0.5, width - 1, height - 1);
  }
}

/** A strip of the colours with what its ends mean. */
export function colourLegend(low, high, title) {
  const strip = document.createElement("span");
  strip.className = "strip";
  const dark = isDark();
  strip.style.backgroundImage = `linear-gradient(to right, ${[0, 0.2, 0.4, 0.6, 0.8, 1].map((share) => colourAt(share, dark)).join(", ")})`;
  const element = document.createElement("span");
  element.className = "colour-legend note";
  element.append(`${title} ${low} `, strip, ` ${high}`);
  return element;
}
