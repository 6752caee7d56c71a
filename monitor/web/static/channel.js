// One channel: the answers, the trends, the spectra, the map, the blocks in doubt, its events.

import { channelPath, get, query } from "./api.js";
import { Blocks } from "./blocks.js";
import { figure, loadUplot, sayInstead } from "./chart.js";
import { fill, h, setText, symbol, table } from "./dom.js";
import * as fmt from "./fmt.js";
import { Kurtogram } from "./kurtogram.js";
import { RawBlock } from "./raw_block.js";
import { sharedWords } from "./spectral.js";
import { Spectrum } from "./spectrum.js";
import { TrackMap } from "./track_map.js";
import { TrendData } from "./trend_data.js";
import { Trends } from "./trends.js";
import { verdict } from "./verdict.js";
import { Waterfall } from "./waterfall.js";

const RANGES = [["hour", 3600], ["day", 86400], ["week", 7 * 86400], ["all", null], ["final stage", "final"]];
const MOST_POINTS = 1200;
const TABLE_ROWS = 60;
const SOON = 1000;
const SLOWLY = 8000;

export class Channel {
  constructor(app, machine, channel) {
    Object.assign(this, { app, machine, channel });
    this.path = channelPath(machine, channel);
    this.mode = "all";
    this.turn = 0;
    this.falling = null;
    const options = { machine, channel, zone: () => app.zone(machine), info: () => this.info };
    this.head = h("div", { class: "channel-head" });
    this.answers = h("div");
    this.trendBox = figure("Trends", { tools: this.makeRanges() });
    this.trends = new Trends({ ...options, onRange: (from, to) => this.choose(from, to) });
    this.spectrum = new Spectrum({ ...options, onBlock: (block) => this.shown(block) });
    this.waterfall = new Waterfall(
      { ...options, spectrum: () => this.spectrum.spectrum, onBlock: (block) => this.spectrum.load(block) },
    );
    this.raw = new RawBlock(options);
    this.kurtogram = new Kurtogram(options);
    this.map = new TrackMap(options);
    this.blocks = new Blocks({ ...options, onBlocks: (blocks) => this.trends.setBlocks(blocks) });
    this.eventBox = figure("Events");
    this.values = h("details", null, h("summary", null, "Values as a table"), h("div"));
    this.values.addEventListener("toggle", () => this.fillValues());
    this.note = h("p", { class: "note" });
    const left = h("div", { class: "column" }, this.trendBox.element, this.raw.element, this.blocks.element);
    const right = h("div", { class: "column" }, this.spectrum.element, this.waterfall.element, this.kurtogram.element, this.map.element);
    this.element = h(
      "div",
      { class: "channel" },
      this.head,
      this.answers,
      h("div", { class: "columns" }, left, right),
      this.eventBox.element,
    );
    this.drawHead();
  }

  /** A spectrum is shown: mark it, and show what belongs to it. */
  shown(block) {
    const chosen = this.spectrum.following ? null : block;
    this.waterfall.choose(chosen);
    if (this.data) this.sayMissing();
    this.kurtogram.load(chosen);
    this.raw.load(chosen);
  }

  get title() {
    return `${this.machine} / ${this.channel}`;
  }

  makeRanges() {
    this.buttons = RANGES.map(
      ([name]) => h("button", { type: "button", "aria-pressed": "false", onclick: () => this.chooseMode(name) }, name),
    );
    return h("div", { class: "ranges", role: "group", "aria-label": "Stretch of time" }, this.buttons);
  }

  /** Called when the view is in the page. */
  async entered() {
    loadUplot().catch(() => null);
    const records = this.fetchRecords();
    records.catch(() => null);
    if (!(await this.readInfo())) return;
    this.spectrum.load();
    await this.readTrends(records);
    this.waterfall.load();
    this.map.load();
    this.blocks.load();
    this.readEvents();
  }

  async readInfo() {
    try {
      this.info = await get(this.path);
      this.app.model.zones.set(this.machine, this.info.timezone);
    } catch (error) {
      if (this.info) this.app.complain(`What is known of ${this.title} could not be read: ${error.message}`);
      else fill(
        this.element,
        h(
          "div",
          { class: "empty" },
          h("strong", null, error.status === 404 ? "There is no such channel" : "The channel could not be read"),
          error.message,
          h(
            "p",
            null,
            h("a", { href: "#/" }, "All machines"),
            " ",
            h("button", { type: "button", onclick: () => this.app.route() }, "Try again"),
          ),
        ),
      );
      return false;
    }
    this.drawHead();
    return true;
  }

  drawHead() {
    const row = this.app.model.row(this.machine, this.channel);
    this.known = JSON.stringify([row?.status.stage, row?.status.t_fs_block, row?.status.t_eol_block, row?.status.levels]);
    const state = row?.state ?? "no_data";
    fill(
      this.head,
      h(
        "div",
        { class: "bar" },
        h("nav", { "aria-label": "Way back" }, h("a", { href: "#/" }, "Machines"), " / "),
        h("h1", null, h("span", { class: "of" }, `${this.machine} / `), this.channel),
        h("span", { class: "state", "data-state": state }, symbol(state)),
      ),
    );
    this.element.toggleAttribute("data-stale", Boolean(row?.stale));
    const age = row ? this.app.model.age(row) : null;
    fill(
      this.answers,
      verdict({ row, info: this.info, zone: this.app.zone(this.machine), age, machine: this.app.model.machines.get(this.machine) }),
    );
  }

  /** Points that the width can show. */
  points() {
    return Math.min(MOST_POINTS, Math.max(300, Math.round(this.trendBox.body.clientWidth || 800)));
  }

  span() {
    const { first_s: first, last_s: last } = this.extent ?? {};
    if (this.mode === "all" || !fmt.isNumber(last)) return [null, null];
    if (this.mode === "final") {
      const begin = this.info.marks?.t_fs_s;
      return fmt.isNumber(begin) ? [begin - 0.25 * (last - begin) - 1, last] : [null, null];
    }
    if (typeof this.mode === "number") return [Math.max(first, last - this.mode), last];
    return this.mode;
  }

  fetchRecords() {
    const [from, to] = this.span();
    return get(`${this.path}/records${query({ from, to, points: this.points() })}`);
  }

  async readTrends(asked = null) {
    const turn = (this.turn += 1);
    const [from, to] = this.span();
    let answer;
    try {
      answer = await (asked ?? this.fetchRecords());
    } catch (error) {
      if (turn !== this.turn) return;
      this.trends.destroy();
      sayInstead(this.trendBox.body, `The records could not be read: ${error.message}`, () => this.readTrends());
      return;
    }
    if (turn !== this.turn) return;
    this.data = new TrendData(answer);
    this.extent = { first_s: answer.first_s, last_s: answer.last_s };
    await this.drawTrends(from === null ? [answer.first_s, answer.last_s] : [from, to]);
  }

  async drawTrends(range) {
    this.updateRanges();
    if (!this.data.size && !fmt.isNumber(this.extent.last_s)) {
      this.trends.destroy();
      sayInstead(this.trendBox.body, "No usable block has been recorded yet. The trends begin with the first one.");
      return;
    }
    if (!this.trends.element.isConnected) fill(
      this.trendBox.body,
      h(
        "div",
        { class: "under-head" },
        this.trends.when,
        h("span", { class: "note hint" }, "drag or Ctrl+wheel to zoom, double click for all"),
      ),
      this.trends.element,
      this.note,
      this.values,
    );
    await this.trends.draw(this.info, this.data, range);
    this.sayMissing();
    this.fillValues();
  }

  /** What is not drawn, and why; what is constant needs no picture. */
  sayMissing() {
    const notes = [];
    const speed = this.data.constant(["speed_hz", "speed_min_hz", "speed_max_hz"]);
    const load = this.data.constant(["load_newton"]);
    if (speed !== null) notes.push(`Shaft speed ${fmt.hertz(speed)} (${fmt.number(speed * 60, 4)} rpm) throughout.`);
    if (load !== null) notes.push(`Load ${fmt.withUnit(load, "N")} throughout.`);
    const shared = sharedWords(this.spectrum.spectrum);
    if (shared) notes.push(`On one peak, which both sums hold: ${shared}.`);
    if (!this.data.column("v_eq_mm2")) notes.push(
      this.info.tracked ? "No V_eq in this stretch: it is tracked from the start of the final stage on." : "V_eq and time to threshold are not asked for on this channel.",
    );
    if (this.data.resolution) notes.push(`Each point spans ${fmt.duration(this.data.resolution)}: smallest and largest value in it.`);
    if (this.data.updating) notes.push("Older records are still being summed up; the picture fills by itself.");
    setText(this.note, notes.join(" "));
    if (this.data.updating) {
      clearTimeout(this.again);
      this.again = setTimeout(() => this.readTrends(), 2000);
    }
  }

  updateRanges() {
    const whole = (this.extent?.last_s ?? 0) - (this.extent?.first_s ?? 0);
    RANGES.forEach(([name, length], index) => {
      const button = this.buttons[index];
      button.disabled = typeof length === "number" ? whole <= length : length === "final" && !fmt.isNumber(this.info.marks?.t_fs_s);
      const on = this.mode === (length ?? "all");
      button.setAttribute("aria-pressed", String(on));
    });
  }

  chooseMode(name) {
    this.mode = RANGES.find(([one]) => one === name)[1] ?? "all";
    this.readTrends();
  }

  /** A stretch chosen by hand; everything where none is given. */
  choose(from, to) {
    const { first_s: first, last_s: last } = this.extent;
    if (from === null || (from <= first && to >= last)) {
      if (this.mode === "all") return;
      this.mode = "all";
    } else {
      const length = Math.min(Math.max(to - from, this.data.resolution ? 1 : 3 * Math.min(this.data.step, last - first)), last - first);
      const begin = Math.min(Math.max(from, first), last - length);
      this.mode = [begin, begin + length];
      // What is there is stretched at once; finer data follow.
      this.trends.setRange(this.mode);
    }
    this.updateRanges();
    clearTimeout(this.reading);
    this.reading = setTimeout(() => this.readTrends(), 120);
  }

  /** New points of this channel. */
  addRecords(answer) {
    if (!this.data) return;
    if (!this.data.size) {
      // The first records of all: those that came are all there are.
      this.data = new TrendData(answer);
      this.extent = { first_s: answer.columns.time_s?.[0] ?? null, last_s: answer.columns.time_s?.at(-1) ?? null };
      this.drawTrends([this.extent.first_s, this.extent.last_s]);
      return;
    }
    const end = this.extent.last_s;
    const last = answer.last_s ?? answer.columns?.time_s?.at(-1) ?? end;
    this.extent.last_s = Math.max(end, last);
    if (Array.isArray(this.mode)) return;
    this.data.append(answer);
    if (this.data.size > 1.6 * this.points()) {
      this.readTrends();
      return;
    }
    const [from, to] = this.span();
    this.drawTrends(from === null ? [this.extent.first_s, this.extent.last_s] : [from, to]);
  }

  fillValues() {
    if (!this.values.open || !this.data) return;
    const shown = Object.keys(this.data.columns).filter((name) => name.endsWith("_max")).map((name) => name.slice(0, -4)).filter(
      (name) => this.data.column(name),
    );
    const stride = Math.max(1, Math.ceil(this.data.size / TABLE_ROWS));
    const zone = this.app.zone(this.machine);
    const rows = [];
    for (let i = this.data.size - 1; i >= 0; i -= stride) {
      const cells = shown.map((name) => {
        const { low, high } = this.data.column(name);
        return low[i] === high[i] ? fmt.number(high[i]) : fmt.interval(low[i], high[i]);
      });
      rows.push([fmt.moment(this.data.time[i], { dated: this.data.dated, zone }), ...cells]);
    }
    fill(
      this.values.lastChild,
      stride > 1 ? h("p", { class: "note" }, `one of every ${stride} points; zoom in for more`) : null,
      table("Values of the trends, newest first", ["Time", ...shown], rows, "numbers"),
    );
  }

  async readEvents() {
    const { eventItem } = await import("./events.js");
    try {
      const { events } = await get(`api/events${query({ machine: this.machine, limit: 200 })}`);
      const mine = events.filter((event) => !event.channel || event.channel === this.channel);
      const shown = mine.slice(0, 8);
      fill(
        this.eventBox.body,
        shown.length ? h(
          "ol",
          { class: "events plain" },
          shown.map((event) => eventItem(this.app, event, () => this.readEvents().then(() => this.app.countEvents()))),
        ) : h("p", null, "Nothing has happened yet."),
        mine.length > shown.length ? h(
          "p",
          null,
          h("a", { href: `#/events?machine=${encodeURIComponent(this.machine)}` }, `all ${mine.length}`),
        ) : null,
      );
    } catch (error) {
      sayInstead(this.eventBox.body, `The events could not be read: ${error.message}`, () => this.readEvents());
    }
  }

  on(kind, data) {
    if (!this.info) {
      if (kind === "machines") this.drawHead();
      return;
    }
    const actions = {
      machines: () => this.machinesChanged(),
      failure: () => this.drawHead(),
      records: () => this.addRecords(data),
      spectrum: () => this.newSpectrum(),
      events: () => this.readEvents(),
      prefs: () => this.redraw(),
    };
    actions[kind]?.();
  }

  machinesChanged() {
    const before = this.known;
    this.drawHead();
    if (this.known !== before) this.readInfo().then((read) => read && this.data && this.redraw());
    const rejected = this.app.model.machines.get(this.machine)?.sources?.[this.info.source]?.rejected;
    if (rejected !== this.rejected) {
      if (this.rejected !== undefined) this.blocks.load();
      this.rejected = rejected;
    }
  }

  newSpectrum() {
    this.spectrum.newer();
    // What takes long to read follows at its own pace; it is not put off by the next block.
    this.falling ??= setTimeout(() => {
      this.falling = null;
      this.waterfall.load();
      this.blocks.load();
      if (this.info.tracked) this.map.load();
    }, this.waterfall.data ? SLOWLY : SOON);
  }

  /** Another theme, zone, level or mark. */
  redraw() {
    this.drawHead();
    if (this.data) this.drawTrends(this.trends.range ?? [this.extent.first_s, this.extent.last_s]);
    this.spectrum.draw();
    this.waterfall.redraw();
    this.raw.draw();
    this.kurtogram.redraw();
    this.map.redraw();
    this.blocks.draw();
    this.readEvents();
  }

  close() {
    clearTimeout(this.reading);
    clearTimeout(this.falling);
    clearTimeout(this.again);
    this.turn += 1;
    for (const part of [this.trends, this.spectrum, this.waterfall, this.raw, this.kurtogram, this.map]) part.close();
  }
}
