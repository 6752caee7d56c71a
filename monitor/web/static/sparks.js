// Levels of the rows that are in view: the latest RMS and its course, read in small lots after everything else.

import { get, machinePath, query } from "./api.js";
import { fill, h } from "./dom.js";
import * as fmt from "./fmt.js";

const LOT = 20;
const FIRST_MS = 400;
const PAUSE_MS = 150;
const OLD_MS = 60000;
const SIZE = [76, 18];
const SVG = "http://www.w3.org/2000/svg";

/** A line of positive values on a logarithmic scale that spans at least a factor of two. */
export function sparkline(values) {
  const logs = values.filter((value) => value > 0).map(Math.log);
  if (logs.length < 2) return null;
  const [width, height] = SIZE;
  const low = Math.min(...logs);
  const span = Math.max(Math.max(...logs) - low, Math.log(2));
  const points = logs.map((value, i) => `${(1 + (i / (logs.length - 1)) * (width - 4)).toFixed(1)},${(height - 2 - ((value - low) / span) * (height - 4)).toFixed(1)}`);
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "spark");
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `RMS from ${fmt.number(values[0])} to ${fmt.number(values.at(-1))} over the life`);
  const line = document.createElementNS(SVG, "polyline");
  line.setAttribute("points", points.join(" "));
  svg.append(line);
  return svg;
}

export class Sparks {
  constructor() {
    this.cells = new Map();
    this.waiting = new Map();
    this.observer = new IntersectionObserver((entries) => entries.forEach((entry) => this.seen(entry)), { rootMargin: "120px" });
    this.timer = setTimeout(() => this.work(), FIRST_MS);
  }

  /** Fill a cell once its row comes into view. */
  watch(row, cell, machine, channel) {
    if (channel === null || this.cells.has(row)) return;
    this.cells.set(row, { cell, machine, channel, read: -Infinity, visible: false });
    this.observer.observe(row);
  }

  forget(row) {
    this.observer.unobserve(row);
    this.cells.delete(row);
    this.waiting.delete(row);
  }

  seen({ target, isIntersecting }) {
    const found = this.cells.get(target);
    if (!found) return;
    found.visible = isIntersecting;
    if (isIntersecting && performance.now() - found.read > OLD_MS) this.waiting.set(target, found);
  }

  async work() {
    for (const [row, found] of this.cells)
      if (found.visible && performance.now() - found.read > OLD_MS) this.waiting.set(row, found);
    const lot = this.next();
    if (lot.length && !document.hidden) {
      const channels = lot.map(({ channel }) => channel).join(",");
      const answer = await get(`${machinePath(lot[0].machine)}/levels${query({ channels })}`).catch(() => null);
      for (const found of lot) {
        found.read = performance.now();
        this.show(found, answer?.channels[found.channel]);
      }
    }
    if (!this.closed) this.timer = setTimeout(() => this.work(), this.waiting.size ? PAUSE_MS : 1000);
  }

  /** Rows of one machine that are still in view. */
  next() {
    const lot = [];
    for (const [row, found] of this.waiting) {
      if (lot.length === LOT) break;
      if (lot.length && found.machine !== lot[0].machine) continue;
      this.waiting.delete(row);
      if (found.visible) lot.push(found);
    }
    return lot;
  }

  show({ cell }, level) {
    if (!level || !fmt.isNumber(level.latest_g)) return;
    fill(cell, sparkline(level.rms_g), h("span", { class: "whole" }, fmt.level(level.latest_g, level.unit)));
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
    this.observer.disconnect();
  }
}
