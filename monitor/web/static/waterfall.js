// The spectra of a life beneath each other, newest on top; a click shows that spectrum.

import { channelPath, get, query } from "./api.js";
import { Board, colourLegend, picture, ticks } from "./canvas.js";
import { figure, onWidth, sayInstead } from "./chart.js";
import { choice, fill, h, setText } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { LINE_NAMES, PARTS, bearingFault } from "./words.js";

const HEIGHT = 300;
const BINS = 300;

function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

export class Waterfall {
  /** @param options machine, channel, zone(), info(), spectrum(): the one that is shown, onBlock(block) */
  constructor(options) {
    this.options = options;
    this.chosen = null;
    const box = figure("Spectra over the life", { note: "logarithmic colours; click for the spectrum" });
    this.element = box.element;
    this.body = box.body;
    this.readout = h("span", { class: "note readout" });
    this.legend = h("span");
    this.axis = choice("axis", [["order", "orders of the shaft"], ["hertz", "Hz"]], (value) => this.load(value));
    this.board = new Board("Spectra over time");
    const { canvas } = this.board;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "slider");
    canvas.addEventListener("click", (event) => this.pick(this.rowAt(event)));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerleave", () => setText(this.readout, ""));
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.content = [
      h("div", { class: "under-head" }, this.legend, this.readout),
      canvas,
      h("div", { class: "controls" }, this.axis.element, exportButtons(() => this.file(), ["PNG", "CSV"])),
    ];
    this.stop = onWidth(this.body, (width) => {
      this.width = width;
      this.draw();
    });
  }

  /** Read the spectra; over orders where the speed varies, unless an axis was chosen. */
  async load(axis = this.chosenAxis) {
    this.chosenAxis = axis;
    try {
      this.data = await get(`${channelPath(this.options.machine, this.options.channel)}/waterfall${query({ bins: BINS, axis })}`);
    } catch (error) {
      this.data = null;
      if (error.status === 404) sayInstead(this.body, "No spectrum is kept yet.");
      else sayInstead(this.body, `The spectra could not be read: ${error.message}`, () => this.load());
      return;
    }
    if ((this.data.blocks?.length ?? 0) < 2) {
      this.data = null;
      sayInstead(this.body, "Fewer than two spectra are kept by now.");
      return;
    }
    this.scale();
    this.image = null;
    this.orders = this.data.domain === "order";
    this.bins = this.data[this.orders ? "order" : "frequency_hz"];
    this.axis.select.value = this.data.domain;
    this.axis.element.hidden = !this.data.varies;
    fill(this.body, this.content);
    this.draw();
  }

  /** What the files hold: the highest amplitude in each bin, a column for each block. */
  file() {
    if (!this.data) return null;
    const { machine, channel } = this.options;
    const unit = this.data.unit === "g" ? "g" : "unit of the sensor";
    const columns = this.data.blocks.map((block, row) => [`block ${block}, ${unit}`, this.data.amplitude_g[row]]);
    return {
      name: `${machine}-${channel}-spectra`,
      title: `Envelope spectra over the life; ${machine}, ${channel}`,
      canvas: this.board.canvas,
      columns: [[this.title(), this.bins], ...columns],
    };
  }

  title() {
    if (this.orders) return "order of the shaft";
    return this.data.varies ? "frequency, Hz at the mean speed of each block" : "frequency, Hz";
  }

  scale() {
    const all = this.data.amplitude_g.flat().filter((value) => value > 0);
    this.low = quantile(all, 0.3);
    this.high = Math.max(quantile(all, 0.9995), this.low * 3);
  }

  draw() {
    if (!this.data || !this.width) return;
    const { board, data } = this;
    const span = Math.log(this.high / this.low);
    // Newest on top: the last row first.
    this.image ??= picture(
      data.amplitude_g.map(
        (row) => row.map((value) => (fmt.isNumber(value) ? (value > 0 ? Math.log(value / this.low) / span : 0) : NaN)),
      ).reverse(),
    );
    const context = board.begin(this.width, HEIGHT, { left: 92, top: 18 });
    const { left, top, width, height } = board.plot;
    context.imageSmoothingEnabled = false;
    context.drawImage(this.image, left, top, width, height);
    board.frame();
    const highest = this.bins.at(-1);
    const x = (frequency) => left + (width * frequency) / highest;
    board.bottomAxis(ticks(0, highest, width / 90).map((value) => [value, fmt.number(value)]), x, this.title());
    board.leftAxis(this.timeMarks(height), (row) => this.rowTop(row) + height / data.blocks.length / 2);
    this.markLines(x);
    this.markChosen();
    fill(
      this.legend,
      colourLegend(fmt.level(this.low, this.options.info()?.unit), fmt.level(this.high, this.options.info()?.unit), "amplitude"),
    );
    this.describe();
  }

  rowTop(row) {
    const { top, height } = this.board.plot;
    const many = this.data.blocks.length;
    return top + (height * (many - 1 - row)) / many;
  }

  timeMarks(height) {
    const many = this.data.blocks.length;
    const wanted = Math.min(many, Math.floor(height / 44));
    const marks = [];
    for (let i = 0; i < wanted; i += 1) {
      const row = Math.round((i * (many - 1)) / Math.max(1, wanted - 1));
      marks.push([row, this.shortTime(this.data.time_s[row])]);
    }
    return marks;
  }

  shortTime(time) {
    if (!fmt.isNumber(time)) return "";
    const info = this.options.info();
    if (info?.dated === null) return "";
    if (!info?.dated) return fmt.duration(time);
    const words = fmt.moment(time, { zone: this.options.zone(), seconds: false });
    const whole = this.data.time_s.at(-1) - this.data.time_s[0];
    if (whole < 3600) return fmt.moment(time, { zone: this.options.zone() }).slice(11, 19);
    return whole > 3 * 86400 ? words.slice(0, 10) : words.slice(5, 16);
  }

  /** Where the first lines stand; a name only where it has room, the damaged part's first. */
  markLines(x) {
    const { top, left, width } = this.board.plot;
    const fault = bearingFault(this.options.info()?.state) ?? "";
    const shown = this.options.spectrum();
    const named = [];
    for (const part of [...PARTS].sort((a, b) => fault.includes(b) - fault.includes(a))) {
      const first = shown?.lines_hz?.[part] / (this.orders ? shown.speed_hz : 1);
      const at = fmt.isNumber(first) ? x(first) : -1;
      if (at < left || at > left + width) continue;
      this.board.line([[at, top - 5], [at, top]], colour(part), { width: 2 });
      if (named.some((other) => Math.abs(other - at) < 34)) continue;
      named.push(at);
      this.board.text(LINE_NAMES[part], Math.max(at, left + 14), top - 6, { base: "bottom", ink: colour(part), size: 10 });
    }
  }

  markChosen() {
    const row = this.data.blocks.indexOf(this.chosen);
    if (row < 0) return;
    const { left, width, height } = this.board.plot;
    const y = this.rowTop(row);
    const tall = Math.max(2, height / this.data.blocks.length);
    const { context } = this.board;
    context.strokeStyle = colour("path");
    context.lineWidth = 1.5;
    context.strokeRect(left - 1, y - 1, width + 2, tall + 2);
  }

  describe() {
    const { canvas } = this.board;
    const many = this.data.blocks.length;
    const row = this.data.blocks.indexOf(this.chosen);
    const at = row < 0 ? many - 1 : row;
    canvas.setAttribute("aria-label", `Spectra over time, ${many} of them; arrows choose one`);
    canvas.setAttribute("aria-valuemin", "1");
    canvas.setAttribute("aria-valuemax", String(many));
    canvas.setAttribute("aria-valuenow", String(at + 1));
    canvas.setAttribute("aria-valuetext", `block ${this.data.blocks[at]}, ${this.shortTime(this.data.time_s[at])}`);
  }

  /** Mark the spectrum that is shown elsewhere. */
  choose(block) {
    this.chosen = block;
    this.draw();
  }

  rowAt(event) {
    const box = this.board.canvas.getBoundingClientRect();
    const { top, height } = this.board.plot;
    const share = (event.clientY - box.top - top) / height;
    const many = this.data.blocks.length;
    return share < 0 || share > 1 ? -1 : Math.min(many - 1, Math.floor((1 - share) * many));
  }

  moved(event) {
    const row = this.data ? this.rowAt(event) : -1;
    if (row < 0) return setText(this.readout, "");
    const box = this.board.canvas.getBoundingClientRect();
    const { left, width } = this.board.plot;
    const { bins } = this;
    const share = (event.clientX - box.left - left) / width;
    const bin = bins.findIndex((value) => value >= share * bins.at(-1));
    const value = share >= 0 && bin >= 0 ? `, ${this.orders ? `order ${fmt.number(bins[bin])}` : fmt.hertz(bins[bin], 4)}: ${fmt.level(this.data.amplitude_g[row][bin], this.options.info()?.unit)}` : "";
    return setText(this.readout, `block ${this.data.blocks[row]}, ${this.shortTime(this.data.time_s[row])}${this.data.varies ? ` at ${fmt.hertz(this.data.speed_hz[row], 3)}` : ""}${value}`);
  }

  pick(row) {
    if (row >= 0 && row < this.data.blocks.length) this.options.onBlock(this.data.blocks[row]);
  }

  key(event) {
    const by = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!by || !this.data) return;
    event.preventDefault();
    event.stopPropagation();
    const many = this.data.blocks.length;
    const row = this.data.blocks.indexOf(this.chosen);
    this.pick(Math.min(many - 1, Math.max(0, (row < 0 ? many - 1 : row) + by)));
  }

  /** Another theme or zone. */
  redraw() {
    this.image = null;
    this.draw();
  }

  close() {
    this.stop();
  }
}
