// The envelope spectrum of a block with the lines of the damaged parts.

import { channelPath, get, query } from "./api.js";
import { figure, sayInstead } from "./chart.js";
import { fill, h } from "./dom.js";
import * as fmt from "./fmt.js";
import { baselineBlock, quantityOf } from "./spectral.js";
import { SpectrumPlot } from "./spectrum_plot.js";
import { domainWord } from "./words.js";

/** A spectrum of the server as the plot takes it. */
function traceOf(answer) {
  return {
    ...answer,
    ...quantityOf("envelope", answer.unit),
    frequency: answer.amplitude_g.map((_, index) => index * answer.resolution_hz),
    amplitude: answer.amplitude_g,
    resolution: answer.resolution_hz,
  };
}

/** What a spectrum of these blocks can be compared with. */
export function otherBlocks(blocks, shown, state) {
  const baseline = baselineBlock(blocks.filter((block) => block !== shown), state);
  return [
    ...(baseline === null ? [] : [["baseline", `the baseline (block ${baseline})`]]),
    ...blocks.filter((block) => block !== shown).reverse().map((block) => [String(block), `block ${block}`]),
  ];
}

export class Spectrum {
  /** @param options machine, channel, zone(), info() and onBlock(block): another spectrum is shown */
  constructor(options) {
    this.options = options;
    this.following = true;
    const box = figure("Envelope spectrum");
    this.element = box.element;
    this.body = box.body;
    this.earlier = h("button", { type: "button", class: "quiet", "aria-label": "Earlier spectrum", onclick: () => this.stepTo(-1) }, "←");
    this.later = h("button", { type: "button", class: "quiet", "aria-label": "Later spectrum", onclick: () => this.stepTo(1) }, "→");
    this.latest = h("button", { type: "button", onclick: () => this.load(null) }, "Latest");
    box.element.querySelector(".figure-head").append(h("span", { class: "buttons" }, this.earlier, this.later, this.latest));
    this.plot = new SpectrumPlot({
      info: options.info,
      zone: options.zone,
      name: `${options.machine}-${options.channel}-envelope`,
      title: (trace) => `Envelope spectrum of block ${trace.block}`,
      describe: (trace) => this.describe(trace),
      others: () => otherBlocks(this.spectrum?.blocks ?? [], this.spectrum?.block, options.info()?.state),
      compare: async (value) => traceOf(await this.ask(
        value === "baseline" ? baselineBlock(this.spectrum.blocks.filter((block) => block !== this.spectrum.block), options.info()?.state) : Number(value),
      )),
    });
  }

  ask(block) {
    return get(`${channelPath(this.options.machine, this.options.channel)}/spectrum${query({ block })}`);
  }

  describe(trace) {
    const [low, high] = trace.band_hz ?? [];
    const when = fmt.moment(trace.time_s, { dated: this.options.info()?.dated, zone: this.options.zone() });
    const band = fmt.isNumber(low) ? `; band ${fmt.number(low)} to ${fmt.number(high)} Hz` : "";
    const speeds = fmt.speeds(trace.speed_range_hz);
    const line = trace.domain === "order" ? `; ${domainWord("order")}, ${fmt.number(trace.resolution_hz / trace.speed_hz, 2)}` : `; ${fmt.number(trace.resolution_hz, 2)} Hz`;
    return `${when}, block ${trace.block}${band}${speeds ? `; ${speeds}` : ""}${line} a line`;
  }

  /** Read a spectrum and show it; the newest where no block is named. */
  async load(block = null) {
    this.following = block === null;
    try {
      this.spectrum = await this.ask(block);
      this.failure = null;
      await this.draw();
      this.options.onBlock?.(this.spectrum.block);
    } catch (error) {
      this.failure = error;
      this.spectrum = null;
      this.plot.destroy();
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
    if (!this.plot.element.isConnected) fill(this.body, this.plot.element);
    this.updateButtons();
    await this.plot.show(traceOf(this.spectrum));
  }

  close() {
    this.plot.close();
  }
}
