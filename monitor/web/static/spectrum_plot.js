// A spectrum with axes in Hz, orders and decibels, cursors, peaks, a second spectrum to compare with, and files.

import { axis, loadUplot, logLabels, numberPoints, onWidth, translucent, valueAxis, verticalLine } from "./chart.js";
import { choice, fill, h, setText, table } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { amplitudeAt, amplitudeText, cursorLines, decibel, faultLines, lineNear, ORDERS, onGrid, peaks, shaftLines, unitText } from "./spectral.js";
import { lineRows, peakRows, spectrumFile } from "./spectrum_tables.js";
import { PARTS, PART_NAMES, bearingFault } from "./words.js";

const HEIGHT = 240;
const DECADES = 5;
const DECIBELS = 100;

export class SpectrumPlot {
  /**
   * @param options info(), zone(), name (of files), title(trace), describe(trace); compare(value) -> trace or null, and
   *   others() -> [[value, text], ...] of what can be compared with
   */
  constructor(options) {
    this.options = options;
    this.sidebands = false;
    this.parts = new Map();
    this.view = { axis: "hz", scale: "linear", cursor: "lines" };
    this.cursor = { at: null, spacing: null };
    this.caption = h("span", { class: "note" });
    this.readout = h("span", { class: "note readout" });
    this.holder = h("div", { class: "plot" });
    this.switches = h("div", { class: "switches", role: "group", "aria-label": "Lines shown" });
    this.controls = this.makeControls();
    this.peakBox = h("details", null, h("summary", null, "Highest peaks"), h("div"));
    this.peakBox.addEventListener("toggle", () => this.fillPeaks());
    this.lineBox = h("details", null, h("summary", null, "Amplitudes at the lines"), h("div"));
    this.lineBox.addEventListener("toggle", () => this.fillTable());
    this.element = h(
      "div",
      { class: "spectrum" },
      h("div", { class: "under-head" }, this.caption, this.readout),
      this.holder,
      this.switches,
      this.controls,
      this.peakBox,
      this.lineBox,
    );
    this.stop = onWidth(this.holder, (width) => this.resize(width));
  }

  makeControls() {
    this.axisChoice = choice("axis", [["hz", "Hz"], ["orders", "orders of the shaft"]], (value) => {
      this.picked = value;
      this.setAxis(value);
      this.draw();
    });
    this.scaleChoice = choice("scale", [["linear", "linear"], ["log", "logarithmic"], ["db", "dB"]], (value) => {
      this.scaled = this.view.scale = value;
      this.draw();
    });
    const cursor = choice("cursor", [["lines", "lines of parts"], ["harmonics", "harmonics"], ["sidebands", "sidebands"]], (value) => {
      this.view.cursor = value;
      this.showCursor();
    });
    this.compareChoice = choice("compare with", [["", "nothing"]], (value) => this.compareWith(value));
    const number = (label, key) => {
      const input = h("input", {
        type: "number", step: "any", min: "0", "aria-label": label,
        onchange: () => {
          this.cursor[key] = input.value === "" ? null : Number(input.value) * this.unit();
          this.plot?.redraw(false);
          this.sayCursor();
        },
      });
      return { input, element: h("label", { class: "pick" }, `${label} `, input, h("span", { class: "unit" })) };
    };
    this.at = number("cursor at", "at");
    this.spacing = number("spacing", "spacing");
    this.cursorText = h("p", { class: "note cursor-text", role: "status" });
    const row = h(
      "div",
      { class: "controls", role: "group", "aria-label": "Axes, cursors, files" },
      this.axisChoice.element, this.scaleChoice.element, this.compareChoice.element, cursor.element, this.at.element, this.spacing.element,
      exportButtons(() => spectrumFile(this)),
    );
    this.at.element.hidden = this.spacing.element.hidden = true;
    return h("div", null, row, this.cursorText);
  }

  /** Show a spectrum: {frequency, amplitude, resolution, quantity, unit, si, decibel, block, speed_hz, lines_hz, ...}. */
  async show(trace) {
    const faster = trace.speed_hz / this.trace?.speed_hz;
    this.trace = trace;
    // Over orders, the cursor stays at its order.
    if (this.view.axis === "orders" && faster > 0) for (const key of ["at", "spacing"]) this.cursor[key] &&= this.cursor[key] * faster;
    this.setOthers();
    await this.compareWith(this.compareChoice.select.value, false);
    const known = fmt.isNumber(trace.speed_hz);
    this.axisChoice.select.disabled = !known;
    this.setAxis(known ? this.picked ?? (trace.domain === "order" ? "orders" : "hz") : "hz");
    this.view.scale = this.scaleChoice.select.value = this.scaled ?? trace.scale ?? "linear";
    this.makeSwitches();
    await this.draw();
  }

  setOthers() {
    const { select } = this.compareChoice;
    const before = select.value;
    const others = [["", "nothing"], ...(this.options.others?.() ?? [])];
    fill(select, others.map(([value, text]) => h("option", { value }, text)));
    select.value = others.some(([value]) => value === before) ? before : "";
    this.compareChoice.element.hidden = others.length < 2;
  }

  async compareWith(value, draw = true) {
    const asked = (this.asked = (this.asked ?? 0) + 1);
    const other = value ? await this.options.compare(value).catch(() => null) : null;
    if (asked !== this.asked) return;
    this.other = other;
    if (draw) await this.draw();
  }

  /** Take an axis; what is zoomed into stays. */
  setAxis(name) {
    const before = this.unit();
    this.view.axis = this.axisChoice.select.value = name;
    this.zoom &&= this.zoom.map((value) => (value * before) / this.unit());
  }

  /** One of the axis in Hz. */
  unit() {
    return this.view.axis === "orders" ? this.trace.speed_hz : 1;
  }

  /** Frequency in the unit of the axis. */
  across(frequency) {
    return frequency / this.unit();
  }

  /** A frequency in words, that of the axis first. */
  place(frequency) {
    const { speed_hz: speed } = this.trace;
    const order = fmt.isNumber(speed) ? `order ${fmt.number(frequency / speed, 4)}` : "";
    const hertz = fmt.hertz(frequency, 5);
    return this.view.axis === "orders" ? [order, hertz] : [hertz, order];
  }

  up(values) {
    const { scale } = this.view;
    if (scale === "db") return values.map((value) => decibel(value, this.trace));
    return scale === "log" ? values.map((value) => (value > 0 ? value : null)) : values;
  }

  async draw() {
    const { trace } = this;
    if (!trace) return;
    const Uplot = await loadUplot();
    if (trace !== this.trace) return;
    const { zoom } = this;
    this.destroy();
    const orders = this.view.axis === "orders";
    this.x = orders ? trace.frequency.map((f) => this.across(f)) : trace.frequency;
    const factor = orders && fmt.isNumber(this.other?.speed_hz) ? trace.speed_hz / this.other.speed_hz : 1;
    this.overlay = this.other && onGrid(this.other, trace, factor);
    setText(this.caption, this.options.describe(trace) + (this.other ? `; compared with block ${this.other.block}${trace.domain === "order" ? ` at ${fmt.hertz(this.other.speed_hz, 3)}` : ""}` : ""));
    const line = (name) => ({ stroke: colour(name), width: 1, points: { show: false }, spanGaps: true });
    const filled = this.view.scale === "linear" ? { fill: translucent("series", 0.12) } : {};
    const labels = { labelSize: 18, labelGap: 0 };
    this.plot = new Uplot(
      {
        width: this.width ?? 600, height: HEIGHT, legend: { show: false }, padding: [10, 14, 0, 0],
        series: [{}, ...(this.overlay ? [line("series-two")] : []), { ...line("series"), ...filled }],
        scales: { x: { time: false }, y: this.yScale() },
        axes: [
          axis({ size: 26, label: this.xLabel(), ...labels }),
          { ...this.valueAxis(), label: this.yLabel(), ...labels },
        ],
        cursor: { y: false, drag: { x: true, y: false, dist: 6 }, points: { size: 6 } },
        hooks: { draw: [(u) => this.drawOver(u)], setCursor: [(u) => this.moved(u)], setScale: [(u, key) => key === "x" && this.zoomed(u)] },
      },
      [this.x, ...(this.overlay ? [this.up(this.overlay)] : []), this.up(trace.amplitude)],
      this.holder,
    );
    this.plot.over.addEventListener("click", () => this.placeCursor());
    if (zoom) this.plot.setScale("x", { min: zoom[0], max: zoom[1] });
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute("aria-label", `${this.options.title(trace)} up to ${orders ? this.place(trace.frequency.at(-1))[0] : `${fmt.number(trace.frequency.at(-1))} Hz`}; the tables below give peaks and lines.`);
    this.showCursor();
    this.fillTable();
    this.fillPeaks();
  }

  valueAxis() {
    if (this.view.scale === "log") return { ...valueAxis((u, splits) => logLabels(splits)), filter: (u, splits) => splits };
    return valueAxis((u, splits) => splits.map((value) => fmt.number(value, 3)));
  }

  /** What is zoomed into, in the unit of the axis, stays for the next block; null for all. */
  zoomed(u) {
    const { min, max } = u.scales.x;
    this.zoom = min <= this.x[0] && max >= this.x.at(-1) ? null : [min, max];
    this.fillPeaks();
  }

  xLabel() {
    if (this.view.axis === "orders") return "order of the shaft";
    return this.trace.domain === "order" ? `frequency, Hz at the mean speed ${fmt.hertz(this.trace.speed_hz, 3)}` : "frequency, Hz";
  }

  yLabel() {
    const { trace } = this;
    return this.view.scale === "db" ? trace.decibel : [...new Set([trace.quantity, unitText(trace)])].join(", ");
  }

  yScale() {
    if (this.view.scale === "linear") return { range: (u, min, max) => [0, (max || 1) * 1.15] };
    if (this.view.scale === "db") return { range: (u, min, max) => (fmt.isNumber(max) ? [Math.max(min, max - DECIBELS), max + 6] : [0, 1]) };
    return { distr: 3, range: (u, min, max) => (max > 0 ? [10 ** Math.floor(Math.log10(Math.max(min, max * 10 ** -DECADES))), max * 2] : [0.1, 1]) };
  }

  makeSwitches() {
    const fault = bearingFault(this.options.info()?.state);
    const named = fault ? fault.split("|") : ["outer"];
    for (const part of PARTS) if (!this.parts.has(part)) this.parts.set(part, named.includes(part));
    const box = (label, on, name, change) => {
      const input = h("input", { type: "checkbox", checked: on });
      input.addEventListener("change", () => {
        change(input.checked);
        this.plot?.redraw(false);
        this.fillTable();
        this.fillPeaks();
      });
      const swatch = name && h("i", { class: "swatch" });
      swatch?.style.setProperty("--colour", `var(--${name})`);
      return h("label", { class: "switch" }, input, swatch, label);
    };
    const available = PARTS.filter((part) => fmt.isNumber(this.trace.lines_hz?.[part]));
    fill(
      this.switches,
      available.map((part) => box(PART_NAMES[part], this.parts.get(part), part, (on) => this.parts.set(part, on))),
      fmt.isNumber(this.trace.speed_hz) && box("shaft", this.parts.get("shaft") ?? false, "shaft", (on) => this.parts.set("shaft", on)),
      box("side lines", this.sidebands, null, (on) => (this.sidebands = on)),
    );
  }

  shownLines() {
    const lines = PARTS.filter((part) => this.parts.get(part)).flatMap((part) => faultLines(this.trace, part, this.sidebands));
    return this.parts.get("shaft") ? [...lines, ...shaftLines(this.trace)] : lines;
  }

  allLines() {
    return [...PARTS.flatMap((part) => faultLines(this.trace, part, true, 3 * ORDERS)), ...shaftLines(this.trace)];
  }

  drawOver(u) {
    if (this.view.cursor === "lines") this.drawLines(u);
    else this.drawCursor(u);
    if (this.peakBox.open) this.drawPeaks(u);
  }

  drawCursor(u) {
    let labelled = -Infinity;
    for (const { frequency, label } of this.cursorLines()) {
      const at = u.valToPos(this.across(frequency), "x");
      const room = label === "f" || at - labelled > 26;
      if (room) labelled = at;
      verticalLine(u, this.across(frequency), { stroke: colour("path"), dash: label === "f" ? [] : [4, 3], label: room ? label : "" });
    }
  }

  drawLines(u) {
    const rows = new Map([...PARTS, "shaft"].filter((part) => this.parts.get(part)).map((part, index) => [part, index]));
    const labelled = new Map();
    for (const line of this.shownLines()) {
      // A label that has no room beside the one before is left out; the line stands all the same.
      const at = u.valToPos(this.across(line.frequency), "x");
      const crowded = line.label && at - (labelled.get(line.part) ?? -Infinity) < 44;
      if (line.label && !crowded) labelled.set(line.part, at);
      verticalLine(u, this.across(line.frequency), {
        stroke: line.main ? colour(line.part) : translucent(line.part, 0.45),
        dash: line.main ? [4, 3] : [1, 3],
        label: crowded ? "" : line.label,
        row: rows.get(line.part),
      });
    }
  }

  drawPeaks(u) {
    const height = (value) => (this.view.scale === "db" ? decibel(value, this.trace) : value);
    numberPoints(u, this.shownPeaks().map(({ frequency, amplitude }) => [this.across(frequency), height(amplitude)]));
  }

  cursorLines() {
    return cursorLines(this.view.cursor, this.cursor, this.trace);
  }

  /** A click sets the cursor on the highest point nearby. */
  placeCursor() {
    if (this.view.cursor === "lines" || !this.plot || !(this.plot.cursor.left >= 0)) return;
    const index = this.plot.cursor.idx;
    const near = [-3, -2, -1, 0, 1, 2, 3].map((k) => index + k).filter((i) => fmt.isNumber(this.trace.amplitude[i]));
    const best = near.reduce((a, b) => (this.trace.amplitude[b] > this.trace.amplitude[a] ? b : a), index);
    this.cursor.at = this.trace.frequency[best];
    this.showCursor();
  }

  showCursor() {
    const { cursor } = this.view;
    this.at.element.hidden = cursor === "lines";
    this.spacing.element.hidden = cursor !== "sidebands";
    const unit = this.trace ? this.unit() : 1;
    const text = (value) => (fmt.isNumber(value) ? Number((value / unit).toPrecision(7)) : "");
    this.at.input.value = text(this.cursor.at);
    this.spacing.input.value = text(this.cursor.spacing);
    this.spacing.input.placeholder = text(this.trace?.speed_hz);
    for (const { element } of [this.at, this.spacing]) setText(element.lastChild, this.view.axis === "orders" ? " orders" : " Hz");
    this.plot?.redraw(false);
    this.sayCursor();
  }

  sayCursor() {
    if (this.view.cursor === "lines" || !this.trace) return setText(this.cursorText, "");
    const lines = this.cursorLines();
    if (!lines.length) return setText(this.cursorText, "Click into the spectrum, or give a frequency, to set the cursor.");
    const words = lines.slice(0, 21).map(
      ({ frequency, label }) => `${label === "f" ? "f" : this.view.cursor === "harmonics" ? `${label}f` : label} ${this.place(frequency)[0]}: ${amplitudeText(amplitudeAt(this.trace, frequency), this.trace)}`,
    );
    return setText(this.cursorText, `${fmt.counted(lines.length, "line")} marked. ${words.join("; ")}`);
  }

  moved(u) {
    const { trace } = this;
    const index = u.cursor.left >= 0 ? u.cursor.idx : null;
    if (index === null || index === undefined) return setText(this.readout, "");
    const frequency = trace.frequency[index];
    const near = lineNear(this.shownLines(), frequency, trace.resolution);
    const other = this.overlay && fmt.isNumber(this.overlay[index]) ? `; block ${this.other.block}: ${amplitudeText(this.overlay[index], trace)}` : "";
    const value = this.view.scale === "db" ? `${fmt.number(decibel(trace.amplitude[index], trace), 4)} dB` : amplitudeText(trace.amplitude[index], trace);
    return setText(this.readout, `${this.place(frequency).filter(Boolean).join(", ")}: ${value}${other}${near ? ` (${near.name})` : ""}`);
  }

  /** Ends of what is shown, Hz. */
  range() {
    const { min, max } = this.plot?.scales.x ?? {};
    return fmt.isNumber(min) ? [min * this.unit(), max * this.unit()] : [0, this.trace.frequency.at(-1)];
  }

  shownPeaks() {
    const [from, to] = this.range();
    // The mean and slow drift stand below the lowest line.
    const lowest = Math.min(...Object.values(this.trace.lines_hz ?? {}).filter((f) => f > 0), this.trace.speed_hz ?? Infinity);
    return peaks(this.trace, Math.max(from, Number.isFinite(lowest) ? 0.5 * lowest : 0), to);
  }

  fillPeaks() {
    if (!this.peakBox.open || !this.trace || !this.plot) return;
    const rows = peakRows(this);
    const signature = JSON.stringify(rows);
    if (signature === this.listed) return;
    this.listed = signature;
    fill(this.peakBox.lastChild, table("Highest peaks", ["No.", "Frequency", "Order", "Amplitude", this.trace.decibel, "Line"], rows, "numbers"));
    this.plot.redraw(false);
  }

  fillTable() {
    if (!this.lineBox.open || !this.trace) return;
    const lines = PARTS.flatMap((part) => faultLines(this.trace, part, false));
    const shared = lines.some((line) => line.shared.length);
    fill(
      this.lineBox.lastChild,
      shared ? h("p", { class: "note" }, "Lines joined by “=” stand on one peak in this spectrum: it is one line, and counts for neither part alone.") : null,
      table("Amplitudes at the lines", ["Part", "Line", "Frequency", "Order", "Amplitude"], lineRows(this.trace, lines), "numbers"),
    );
  }

  resize(width) {
    this.width = width;
    this.plot?.setSize({ width, height: HEIGHT });
  }

  destroy() {
    this.plot?.destroy();
    this.plot = null;
    this.listed = null;
  }

  close() {
    this.stop();
    this.destroy();
  }
}

