// The envelope spectrum with the lines of the damaged parts, and the table of what stands at them.

import { axis, figure, loadUplot, onWidth, sayInstead, translucent, valueAxis, verticalLine } from "./chart.js";
import { channelPath, get, query } from "./api.js";
import { fill, h, setText, table } from "./dom.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { LINE_NAMES, PARTS, PART_NAMES } from "./words.js";

const HARMONICS = 5;
const NEAR = 0.012;

/** Lines of a part in a spectrum: harmonics, and side lines where they are told apart. */
export function faultLines(spectrum, part, sidebands) {
  const found = [];
  const first = spectrum.lines_hz?.[part];
  if (!fmt.isNumber(first)) return found;
  const side = part === "inner" ? spectrum.speed_hz : part === "ball" ? spectrum.lines_hz.cage : null;
  const sideName = part === "inner" ? "shaft" : "cage";
  for (let n = 1; n <= HARMONICS; n += 1) {
    found.push(
      {
        frequency: n * first,
        label: n === 1 ? LINE_NAMES[part] : `${n}×`,
        name: `${n} × ${LINE_NAMES[part]}`,
        main: true,
        part,
        harmonic: n,
      },
    );
    if (!sidebands || !fmt.isNumber(side)) continue;
    for (const k of [-2, -1, 1, 2])
      found.push(
        {
          frequency: n * first + k * side,
          label: "",
          name: `${n} × ${LINE_NAMES[part]} ${k > 0 ? "+" : "−"} ${Math.abs(k)} × ${sideName}`,
          main: false,
          part,
          harmonic: n,
        },
      );
  }
  return found.filter((line) => line.frequency > 0);
}

/** Largest amplitude within two bins of a frequency, or null beyond the spectrum. */
export function amplitudeAt(spectrum, frequency) {
  const bin = Math.round(frequency / spectrum.resolution_hz);
  const near = spectrum.amplitude_g.slice(Math.max(0, bin - 2), bin + 3).filter(fmt.isNumber);
  return bin < spectrum.amplitude_g.length && near.length ? Math.max(...near) : null;
}

export class Spectrum {
  /** @param options machine, channel, zone(), info() and onBlock(block): another spectrum is shown */
  constructor(options) {
    this.options = options;
    this.following = true;
    this.chosen = null;
    this.sidebands = false;
    this.parts = new Map();
    const box = figure("Envelope spectrum");
    this.element = box.element;
    this.body = box.body;
    this.caption = h("span", { class: "note" });
    this.readout = h("span", { class: "note readout" });
    this.switches = h("div", { class: "switches", role: "group", "aria-label": "Lines shown" });
    this.earlier = h("button", { type: "button", class: "quiet", "aria-label": "Earlier spectrum", onclick: () => this.stepTo(-1) }, "←");
    this.later = h("button", { type: "button", class: "quiet", "aria-label": "Later spectrum", onclick: () => this.stepTo(1) }, "→");
    this.latest = h("button", { type: "button", onclick: () => this.load(null) }, "Latest");
    box.element.querySelector(".figure-head").append(h("span", { class: "buttons" }, this.earlier, this.later, this.latest));
    this.holder = h("div", { class: "plot" });
    this.table = h("details", null, h("summary", null, "Amplitudes at the lines"), h("div"));
    this.table.addEventListener("toggle", () => this.fillTable());
    this.content = [h("div", { class: "under-head" }, this.caption, this.readout), this.holder, this.switches, this.table];
    this.stop = onWidth(this.body, (width) => this.resize(width));
  }

  /** Read a spectrum and show it; the newest where no block is named. */
  async load(block = null) {
    this.following = block === null;
    try {
      const path = `${channelPath(this.options.machine, this.options.channel)}/spectrum${query({ block })}`;
      this.spectrum = await get(path);
      this.failure = null;
      await this.draw();
      this.options.onBlock?.(this.spectrum.block);
    } catch (error) {
      this.failure = error;
      this.spectrum = null;
      this.destroy();
      this.updateButtons();
      if (error.status === 404) sayInstead(this.body, "No spectrum is kept yet. The first usable block gives one.");
      else sayInstead(this.body, `The spectrum could not be read: ${error.message}`, () => this.load(block));
    }
  }

  /** A newer one was kept. */
  newer() {
    if (this.following) this.load(null);
    else this.updateButtons();
  }

  stepTo(by) {
    const blocks = this.spectrum?.blocks ?? [];
    const next = blocks[blocks.indexOf(this.spectrum?.block) + by];
    if (next !== undefined) this.load(next === blocks.at(-1) ? null : next);
  }

  updateButtons() {
    const blocks = this.spectrum?.blocks ?? [];
    const at = blocks.indexOf(this.spectrum?.block);
    this.earlier.disabled = at <= 0;
    this.later.disabled = at < 0 || at >= blocks.length - 1;
    this.latest.hidden = this.following || at < 0;
    this.earlier.hidden = this.later.hidden = at < 0;
  }

  async draw() {
    if (!this.spectrum) return;
    const Uplot = await loadUplot();
    const { spectrum } = this;
    this.destroy();
    if (!this.holder.isConnected) fill(this.body, this.content);
    this.makeSwitches();
    this.updateButtons();
    const info = this.options.info();
    const [low, high] = spectrum.band_hz ?? [];
    const when = fmt.moment(spectrum.time_s, { dated: info?.dated, zone: this.options.zone() });
    const band = fmt.isNumber(low) ? `; band ${fmt.number(low)} to ${fmt.number(high)} Hz` : "";
    setText(this.caption, `${when}, block ${spectrum.block}${band}; ${fmt.number(spectrum.resolution_hz, 2)} Hz a line`);
    const frequencies = spectrum.amplitude_g.map((_, index) => index * spectrum.resolution_hz);
    this.plot = new Uplot(
      {
        width: this.width ?? 600, height: 240, legend: { show: false }, padding: [10, 14, 0, 0],
        series: [{}, { stroke: colour("series"), width: 1, fill: translucent("series", 0.12), points: { show: false } }],
        scales: { x: { time: false }, y: { range: (u, min, max) => [0, (max || 1) * 1.15] } },
        axes: [axis({ size: 26, label: "frequency, Hz", labelSize: 18, labelGap: 0 }), valueAxis()],
        cursor: { y: false, drag: { x: true, y: false, dist: 6 }, points: { size: 6 } },
        hooks: { draw: [(u) => this.drawLines(u)], setCursor: [(u) => this.moved(u)] },
      },
      [frequencies, spectrum.amplitude_g],
      this.holder,
    );
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute(
      "aria-label",
      `Envelope spectrum of block ${spectrum.block} up to ${fmt.number(frequencies.at(-1))} Hz; the table below gives the amplitudes at the lines of each part.`,
    );
    this.fillTable();
  }

  makeSwitches() {
    const fault = this.options.info()?.state?.fault;
    const named = fault ? fault.split("|") : ["outer"];
    for (const part of PARTS) if (!this.parts.has(part)) this.parts.set(part, named.includes(part));
    const box = (label, on, name, change) => {
      const input = h("input", { type: "checkbox", checked: on });
      input.addEventListener("change", () => {
        change(input.checked);
        this.plot?.redraw(false);
        this.fillTable();
      });
      const swatch = name && h("i", { class: "swatch" });
      swatch?.style.setProperty("--colour", `var(--${name})`);
      return h("label", { class: "switch" }, input, swatch, label);
    };
    const available = PARTS.filter((part) => fmt.isNumber(this.spectrum.lines_hz?.[part]));
    fill(
      this.switches,
      available.map((part) => box(PART_NAMES[part], this.parts.get(part), part, (on) => this.parts.set(part, on))),
      fmt.isNumber(this.spectrum.speed_hz) && box("shaft", this.parts.get("shaft") ?? false, "shaft", (on) => this.parts.set("shaft", on)),
      box("side lines", this.sidebands, null, (on) => (this.sidebands = on)),
    );
  }

  shownLines() {
    const lines = PARTS.filter((part) => this.parts.get(part)).flatMap((part) => faultLines(this.spectrum, part, this.sidebands));
    if (this.parts.get("shaft") && fmt.isNumber(this.spectrum.speed_hz))
      for (let n = 1; n <= HARMONICS; n += 1) lines.push(
        {
          frequency: n * this.spectrum.speed_hz,
          label: n === 1 ? "shaft" : "",
          name: `${n} × shaft`,
          main: n === 1,
          part: "shaft",
          harmonic: n,
        },
      );
    return lines;
  }

  drawLines(u) {
    const rows = new Map([...PARTS, "shaft"].filter((part) => this.parts.get(part)).map((part, index) => [part, index]));
    const labelled = new Map();
    for (const line of this.shownLines()) {
      // A label that has no room beside the one before is left out; the line stands all the same.
      const at = u.valToPos(line.frequency, "x");
      const crowded = line.label && at - (labelled.get(line.part) ?? -Infinity) < 44;
      if (line.label && !crowded) labelled.set(line.part, at);
      verticalLine(
        u,
        line.frequency,
        {
          stroke: line.main ? colour(line.part) : translucent(line.part, 0.45),
          dash: line.main ? [4, 3] : [1, 3],
          label: crowded ? "" : line.label,
          row: rows.get(line.part),
        },
      );
    }
  }

  moved(u) {
    const { spectrum } = this;
    const index = u.cursor.left >= 0 ? u.cursor.idx : null;
    if (index === null || index === undefined) return setText(this.readout, "");
    const frequency = index * spectrum.resolution_hz;
    const near = this.shownLines().filter(
      (line) => Math.abs(line.frequency - frequency) <= Math.max(NEAR * line.frequency, 1.5 * spectrum.resolution_hz),
    );
    near.sort((a, b) => Math.abs(a.frequency - frequency) - Math.abs(b.frequency - frequency));
    const order = fmt.isNumber(spectrum.speed_hz) ? `, order ${fmt.number(frequency / spectrum.speed_hz, 4)}` : "";
    return setText(
      this.readout,
      `${fmt.hertz(frequency, 5)}${order}: ${fmt.level(spectrum.amplitude_g[index], spectrum.unit)}${near.length ? ` (${near[0].name})` : ""}`,
    );
  }

  fillTable() {
    if (!this.table.open || !this.spectrum) return;
    const lines = PARTS.flatMap((part) => faultLines(this.spectrum, part, false));
    const rows = lines.map(
      (line) => [
        PART_NAMES[line.part],
        line.name,
        fmt.hertz(line.frequency, 5),
        fmt.isNumber(this.spectrum.speed_hz) ? fmt.number(line.frequency / this.spectrum.speed_hz, 4) : fmt.MISSING,
        fmt.level(amplitudeAt(this.spectrum, line.frequency), this.spectrum.unit),
      ],
    );
    fill(this.table.lastChild, table("Amplitudes at the lines", ["Part", "Line", "Frequency", "Order", "Amplitude"], rows, "numbers"));
  }

  resize(width) {
    this.width = width;
    this.plot?.setSize({ width, height: 240 });
  }

  destroy() {
    this.plot?.destroy();
    this.plot = null;
  }

  close() {
    this.stop();
    this.destroy();
  }
}
