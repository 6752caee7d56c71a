// The samples of a block themselves: spectrum of acceleration or velocity, and the waveform. Read when looked at.

import { channelPath, get, query } from "./api.js";
import { axis, figure, loadUplot, onWidth, sayInstead, valueAxis, verticalLine } from "./chart.js";
import { fill, h, setText } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { QUANTITIES, baselineBlock, quantityOf, toVelocity, turnMarks } from "./spectral.js";
import { otherBlocks } from "./spectrum.js";
import { SpectrumPlot } from "./spectrum_plot.js";
import { LINE_NAMES, PARTS } from "./words.js";

const KINDS = [["acceleration", "acceleration"], ["velocity", "velocity"], ["waveform", "waveform"], ["cyclic", "coherence"], ["ias", "angular speed"]];
const PARTS_OF = { waveform: "waveform", cyclic: "cyclic", ias: "ias" };
const NO_IAS = "No spectrum of the angular speed is kept: it needs 16 marks a turn or more, lines of the bearing below half of them, 16 turns in a block, and is made for the blocks of the waterfall.";
const NOTHING = "Nothing is kept of the samples of this block. They are kept for the newest block and for those of the waterfall, from this version of the program on; other blocks stand in the files of the logger alone.";

/** The coherence as a trace, in Hz at the mean speed. */
function coherenceOf(answer) {
  const { speed_hz: speed, cyclic_order: cyclic } = answer;
  return {
    ...answer, ...QUANTITIES.cyclic, domain: "order", resolution: (cyclic[1] - cyclic[0]) * speed,
    frequency: cyclic.map((order) => order * speed), amplitude: answer.coherence,
  };
}

/** A spectrum over events per revolution in the form of the raw one: in Hz at the mean speed. */
function overOrders(answer) {
  const { speed_hz: speed } = answer;
  return {
    ...answer, domain: "order", amplitude_g: answer.amplitude_rad_s, highest_g: answer.highest_rad_s,
    resolution_hz: answer.resolution_order * speed, width_hz: answer.width_order * speed,
  };
}

/** All lines up to 1 kHz, then the highest in each bin up to the Nyquist frequency. */
function traceOf(answer, kind) {
  if (kind === "cyclic") return coherenceOf(answer);
  const fine = answer.amplitude_g.length;
  const end = (fine - 1) * answer.resolution_hz;
  const first = Math.ceil(end / answer.width_hz + 1e-9);
  const frequency = answer.amplitude_g.map((_, k) => k * answer.resolution_hz);
  for (let k = first; k < answer.highest_g.length; k += 1) frequency.push((k + 0.5) * answer.width_hz);
  const trace = {
    ...answer,
    ...(kind === "ias" ? QUANTITIES.ias : quantityOf("acceleration", answer.unit)),
    frequency,
    amplitude: [...answer.amplitude_g, ...answer.highest_g.slice(first)],
    resolution: answer.resolution_hz,
  };
  return kind === "velocity" ? toVelocity(trace) : trace;
}

export class RawBlock {
  /** @param options machine, channel, zone(), info() */
  constructor(options) {
    this.options = options;
    this.kind = "acceleration";
    this.block = null;
    const box = figure("Acceleration, velocity, waveform");
    this.element = box.element;
    this.body = box.body;
    this.tabs = KINDS.map(([kind, text]) => h("button", { type: "button", "aria-pressed": String(kind === this.kind), onclick: () => this.choose(kind) }, text));
    box.element.querySelector(".figure-head").append(h("span", { class: "ranges", role: "group", "aria-label": "What is shown" }, this.tabs));
    this.plot = new SpectrumPlot({
      info: options.info,
      zone: options.zone,
      name: `${options.machine}-${options.channel}-${this.kind}`,
      title: (trace) => `${{ "mm/s": "Velocity", "rad/s": "Angular speed", null: "Coherence" }[trace.unit] ?? "Acceleration"} spectrum of block ${trace.block}`,
      describe: (trace) => this.describe(trace),
      others: () => (this.kind === "ias" ? [] : otherBlocks(this.answer?.blocks ?? [], this.answer?.block, options.info()?.state)),
      compare: async (value) => traceOf(await this.ask(
        PARTS_OF[this.kind] ?? "raw",
        value === "baseline" ? baselineBlock(this.answer.blocks.filter((block) => block !== this.answer.block), options.info()?.state) : Number(value),
      ), this.kind),
    });
    this.wave = new Waveform(options, (answer) => this.describe(answer));
    this.stale = true;
    this.seen = new IntersectionObserver((entries) => {
      this.visible = entries.at(-1).isIntersecting;
      if (this.visible && this.stale) this.load(this.block);
    }, { rootMargin: "200px" });
    this.seen.observe(this.element);
  }

  ask(part, block) {
    return get(`${channelPath(this.options.machine, this.options.channel)}/${part}${query({ block })}`);
  }

  choose(kind) {
    this.kind = kind;
    this.plot.destroy();
    this.tabs.forEach((tab, index) => tab.setAttribute("aria-pressed", String(KINDS[index][0] === kind)));
    this.plot.options.name = `${this.options.machine}-${this.options.channel}-${kind}`;
    this.load(this.block);
  }

  describe(answer) {
    const when = fmt.moment(answer.time_s, { dated: this.options.info()?.dated, zone: this.options.zone() });
    const seconds = fmt.isNumber(answer.samples) ? `; ${fmt.number(answer.samples / answer.rate_hz, 3)} s at ${fmt.number(answer.rate_hz)} Hz` : "";
    if (answer.coherence) return `${when}, block ${answer.block}; the kept samples, ${fmt.number(answer.band_hz[0])} to ${fmt.number(answer.band_hz[1])} Hz; noise stays below ${fmt.number(answer.limit, 2)}`;
    if (answer.domain === "order") return `${when}, block ${answer.block}${seconds}; ${fmt.number(answer.resolution_order, 2)} events per revolution a line`;
    const beyond = answer.highest_g && this.kind !== "velocity" ? `; ${fmt.number(answer.resolution_hz, 2)} Hz a line up to ${fmt.hertz((answer.amplitude_g.length - 1) * answer.resolution_hz, 3)}, above it the highest in each ${fmt.hertz(answer.width_hz, 3)}` : "";
    const speeds = fmt.speeds(answer.speed_range_hz);
    const smeared = speeds ? `; ${speeds}${answer.highest_g ? ": over time, where lines of the shaft smear" : ""}` : "";
    return `${when}, block ${answer.block}${seconds}${beyond}${smeared}`;
  }

  /** Show a block, the newest where none is named; nothing is read while the figure is out of view. */
  async load(block = null) {
    this.block = block;
    this.stale = !this.visible;
    if (this.stale) return;
    const turn = (this.turn = (this.turn ?? 0) + 1);
    this.tabs.at(-1).hidden = !this.options.info()?.state?.rotation_status;
    try {
      const answer = await this.ask(PARTS_OF[this.kind] ?? "raw", block);
      if (turn !== this.turn) return;
      this.answer = this.kind === "ias" ? overOrders(answer) : answer;
      await this.draw();
    } catch (error) {
      if (turn !== this.turn) return;
      this.answer = null;
      this.plot.destroy();
      if (error.status === 404) sayInstead(this.body, { ias: NO_IAS, cyclic: `There is no coherence: ${error.message}` }[this.kind] ?? NOTHING);
      else sayInstead(this.body, `The block could not be read: ${error.message}`, () => this.load(block));
    }
  }

  async draw() {
    if (!this.answer) return;
    const shown = this.kind === "waveform" ? this.wave.element : this.plot.element;
    if (!shown.isConnected) fill(this.body, shown);
    if (this.kind === "waveform") await this.wave.show(this.answer);
    else if (this.kind === "velocity" && this.answer.unit !== "g") sayInstead(this.body, "There is no velocity: the unit of the sensor is not known.");
    else await this.plot.show(traceOf(this.answer, this.kind));
  }

  close() {
    this.seen.disconnect();
    this.plot.close();
    this.wave.close();
  }
}

/** The beginning of a block over time, with marks one period of a part or of the shaft apart. */
class Waveform {
  constructor(options, describe) {
    Object.assign(this, { options, describe, every: "", from: 0 });
    this.caption = h("span", { class: "note" });
    this.readout = h("span", { class: "note readout" });
    this.holder = h("div", { class: "plot" });
    this.select = h("select", { onchange: () => { this.every = this.select.value; this.plot?.redraw(false); } });
    this.element = h(
      "div",
      null,
      h("div", { class: "under-head" }, this.caption, this.readout),
      this.holder,
      h(
        "div",
        { class: "controls", role: "group", "aria-label": "Marks, files" },
        h("label", { class: "pick" }, "marks every period of ", this.select),
        exportButtons(() => this.file()),
      ),
      h("p", { class: "note" }, "A click sets the first mark; drag to zoom, double click for all."),
    );
    this.stop = onWidth(this.holder, (width) => {
      this.width = width;
      this.plot?.setSize({ width, height: 240 });
    });
  }

  async show(answer) {
    const Uplot = await loadUplot();
    this.plot?.destroy();
    this.answer = answer;
    const time = answer.waveform_g.map((_, k) => k / answer.rate_hz);
    const unit = answer.unit === "g" ? "g" : "unit of the sensor";
    const kept = answer.waveform_g.length < answer.samples ? `; the first ${fmt.number(time.at(-1), 2)} s are kept` : "";
    setText(this.caption, this.describe(answer) + kept);
    const periods = [["", "nothing"], ...(fmt.isNumber(answer.speed_hz) ? [["shaft", "the shaft"]] : []), ...PARTS.filter((part) => fmt.isNumber(answer.lines_hz?.[part])).map((part) => [part, LINE_NAMES[part]])];
    fill(this.select, periods.map(([value, text]) => h("option", { value }, text)));
    this.select.value = this.every;
    this.plot = new Uplot(
      {
        width: this.width ?? 600, height: 240, legend: { show: false }, padding: [10, 14, 0, 0],
        series: [{}, { stroke: colour("series"), width: 1, points: { show: false } }],
        scales: { x: { time: false } },
        axes: [
          axis({ size: 26, label: "time, s", labelSize: 18, labelGap: 0 }),
          { ...valueAxis(), label: `acceleration, ${unit}`, labelSize: 18, labelGap: 0 },
        ],
        cursor: { y: false, drag: { x: true, y: false, dist: 6 }, points: { size: 6 } },
        hooks: { draw: [(u) => this.drawMarks(u)], setCursor: [(u) => this.moved(u)] },
      },
      [time, answer.waveform_g],
      this.holder,
    );
    this.plot.over.addEventListener("click", () => {
      if (this.plot.cursor.left >= 0) this.from = time[this.plot.cursor.idx];
      this.plot.redraw(false);
    });
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute("aria-label", `Waveform of block ${answer.block}, ${fmt.number(time.at(-1), 3)} s.`);
  }

  marks() {
    const rate = this.every === "shaft" ? this.answer.speed_hz : this.answer.lines_hz?.[this.every];
    if (!(rate > 0)) return [];
    const end = this.answer.waveform_g.length / this.answer.rate_hz;
    if (this.answer.speed_hz > 0) return turnMarks(this.answer, this.answer.speed_hz / rate, this.from, end);
    const first = this.from - Math.floor(this.from * rate) / rate;
    return Array.from({ length: Math.floor((end - first) * rate) + 1 }, (_, k) => first + k / rate);
  }

  drawMarks(u) {
    const name = this.every === "shaft" ? "shaft" : this.every;
    for (const at of this.marks()) verticalLine(u, at, { stroke: colour(name), dash: [4, 3] });
  }

  moved(u) {
    const index = u.cursor.left >= 0 ? u.cursor.idx : null;
    if (index === null || index === undefined) return setText(this.readout, "");
    const { answer } = this;
    const turns = fmt.isNumber(answer.speed_hz) ? `, turn ${fmt.number((index / answer.rate_hz) * answer.speed_hz, 3)}` : "";
    return setText(this.readout, `${fmt.number(index / answer.rate_hz, 5)} s${turns}: ${fmt.level(answer.waveform_g[index], answer.unit)}`);
  }

  file() {
    const { answer } = this;
    if (!answer || !this.plot) return null;
    const unit = answer.unit === "g" ? "g" : "unit of the sensor";
    const { min, max } = this.plot.scales.x;
    return {
      name: `${this.options.machine}-${this.options.channel}-waveform-${answer.block}`,
      title: `Waveform of block ${answer.block}; ${this.describe(answer)}`,
      x: "time, s", y: `acceleration, ${unit}`, range: [min, max], canvas: this.plot.ctx.canvas,
      columns: [["time, s", answer.waveform_g.map((_, k) => k / answer.rate_hz)], [`acceleration, ${unit}`, answer.waveform_g]],
      marks: this.marks().map((at) => ({ x: at, label: "", ink: colour(this.every === "shaft" ? "shaft" : this.every) })),
    };
  }

  close() {
    this.stop();
    this.plot?.destroy();
  }
}
