// The kurtogram of a block: how impulsive it is by frequency and width of the band, and the band in use.

import { channelPath, get, query } from "./api.js";
import { Board, colourLegend, picture, ticks } from "./canvas.js";
import { figure, onWidth, sayInstead } from "./chart.js";
import { fill, h, setText } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";

const HEIGHT = 250;
// A multiple of all numbers of bands of a level.
const COLUMNS = 192;
// The colours reach at least this kurtosis, so that noise is not drawn as contrast.
const LEAST_SCALE = 2;

export class Kurtogram {
  /** @param options machine, channel */
  constructor(options) {
    this.options = options;
    this.turn = 0;
    const box = figure("Kurtogram", { note: "strong colours: short bursts" });
    this.element = box.element;
    this.body = box.body;
    this.readout = h("span", { class: "note readout" });
    this.legend = h("span");
    this.board = new Board("Kurtogram");
    const { canvas } = this.board;
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerleave", () => this.describe());
    this.content = [
      h("div", { class: "under-head" }, this.legend, this.readout),
      canvas,
      h("div", { class: "controls" }, exportButtons(() => this.file(), ["PNG", "CSV"])),
    ];
    this.stop = onWidth(this.body, (width) => {
      this.width = width;
      this.draw();
    });
  }

  /** Read the kurtogram kept last, or last up to a block. */
  async load(block = null) {
    this.turn += 1;
    const { turn } = this;
    try {
      const found = await get(`${channelPath(this.options.machine, this.options.channel)}/kurtogram${query({ block })}`);
      if (turn !== this.turn) return;
      const same = this.data?.block === found.block;
      this.data = found;
      if (same) return;
    } catch (error) {
      if (turn !== this.turn) return;
      this.data = null;
      if (error.status === 404) sayInstead(this.body, "No kurtogram is kept yet.");
      else sayInstead(this.body, `The kurtogram could not be read: ${error.message}`, () => this.load(block));
      return;
    }
    this.image = null;
    fill(this.body, this.content);
    this.draw();
  }

  /** What the files hold: the kurtosis of each band. */
  file() {
    if (!this.data) return null;
    const { machine, channel } = this.options;
    const bands = this.data.kurtosis.flatMap((level) => {
      const wide = this.data.nyquist_hz / level.length;
      return level.map((value, place) => [place * wide, (place + 1) * wide, value]);
    });
    const column = (place) => bands.map((band) => band[place]);
    return {
      name: `${machine}-${channel}-kurtogram-${this.data.block}`,
      title: `Kurtogram of block ${this.data.block}; ${machine}, ${channel}`,
      canvas: this.board.canvas,
      columns: [["from, Hz", column(0)], ["to, Hz", column(1)], ["kurtosis", column(2)]],
    };
  }

  draw() {
    if (!this.data || !this.width) return;
    const { board, data } = this;
    const levels = data.kurtosis;
    const highest = Math.max(LEAST_SCALE, ...levels.flat());
    this.image ??= picture(
      levels.map(
        (level) => Array.from(
          { length: COLUMNS },
          (_, column) => Math.sqrt(Math.max(0, level[Math.floor((column * level.length) / COLUMNS)]) / highest),
        ),
      ),
    );
    const context = board.begin(this.width, HEIGHT, { left: 84 });
    const { left, top, width, height } = board.plot;
    context.imageSmoothingEnabled = false;
    context.drawImage(this.image, left, top, width, height);
    board.frame();
    const x = (frequency) => left + (width * frequency) / data.nyquist_hz;
    const tall = height / levels.length;
    board.bottomAxis(ticks(0, data.nyquist_hz, width / 90).map((value) => [value, fmt.number(value)]), x, "frequency, Hz");
    board.leftAxis(
      levels.map((level, row) => [row, fmt.number(data.nyquist_hz / level.length, 2)]),
      (row) => top + (row + 0.5) * tall,
      "width, Hz",
    );
    for (const edge of data.band_hz) board.line([[x(edge), top], [x(edge), top + height]], colour("path"), { width: 1.5, dash: [5, 4] });
    this.markBest(x, tall);
    fill(this.legend, colourLegend("0", fmt.number(highest, 2), "kurtosis"));
    this.describe();
  }

  /** Frame the band of the highest kurtosis. */
  markBest(x, tall) {
    const best = this.data.best_hz;
    if (!best) return;
    const { context, plot } = this.board;
    const count = Math.round(this.data.nyquist_hz / (best[1] - best[0]));
    const row = this.data.kurtosis.findIndex((level) => level.length === count);
    context.strokeStyle = colour("path");
    context.lineWidth = 2;
    context.strokeRect(x(best[0]), plot.top + row * tall, x(best[1]) - x(best[0]), tall);
  }

  describe() {
    if (!this.data) return;
    const { block, band_hz: band, best_hz: best } = this.data;
    const range = ([low, high]) => `${fmt.number(low)} to ${fmt.hertz(high)}`;
    const highest = best ? `highest: ${range(best)} (framed)` : "all within noise";
    const words = `block ${block}, ${highest}; in use: ${range(band)} (dashed)`;
    setText(this.readout, words);
    this.board.canvas.setAttribute("aria-label", `Kurtogram, ${words}`);
  }

  moved(event) {
    if (!this.data) return;
    const box = this.board.canvas.getBoundingClientRect();
    const { left, top, width, height } = this.board.plot;
    const across = (event.clientX - box.left - left) / width;
    const down = (event.clientY - box.top - top) / height;
    if (across < 0 || across >= 1 || down < 0 || down >= 1) return this.describe();
    const row = Math.floor(down * this.data.kurtosis.length);
    const level = this.data.kurtosis[row];
    const place = Math.floor(across * level.length);
    const step = this.data.nyquist_hz / level.length;
    const noise = level[place] > this.data.noise[row] ? "" : ", may be noise";
    return setText(this.readout, `${fmt.number(place * step)} to ${fmt.hertz((place + 1) * step)}: ${fmt.number(level[place], 2)}${noise}`);
  }

  /** Another theme. */
  redraw() {
    this.image = null;
    this.draw();
  }

  close() {
    this.turn += 1;
    this.stop();
  }
}
