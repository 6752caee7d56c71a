// Trends on one time axis: one cursor for all, zoom by drag, wheel and keys, finer data on the way.

import { Legend, axis, horizontalLine, loadUplot, logLabels, onWidth, translucent, valueAxis, verticalLine } from "./chart.js";
import { fill, h, setText } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { placed } from "./trend_data.js";
import { columnsOf, trendFile } from "./trend_file.js";
import { trendSpecs } from "./trend_specs.js";

const SYNC = "spallwatch-trends";
const RUG_HEIGHT = 46;
/** Steps of an axis without a date, s: round in seconds, minutes, hours or days. */
const ELAPSED = [
  0.001, 0.01, 0.1, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400,
  ...[2, 5, 10, 20, 50, 100, 200, 500, 1000].map((days) => days * 86400),
];

export class Trends {
  /**
   * @param options zone(): the zone of times; onRange(from, to): a stretch was chosen, null for all; onCursor(time)
   */
  constructor(options) {
    this.options = options;
    this.charts = [];
    this.blocks = [];
    this.when = h("span", { class: "when" });
    this.stack = h("div", { class: "stack" });
    this.element = h(
      "div",
      {
        class: "trends",
        tabindex: "0",
        role: "group",
        "aria-label": "Trends over time. Plus and minus zoom, arrows move, 0 shows all; the values stand in the table below.",
        onkeydown: (event) => this.key(event),
      },
      this.stack,
    );
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.stop = onWidth(this.stack, (width) => this.resize(width));
  }

  /** Draw everything anew: other data than before, another theme, another zone. */
  async draw(info, data, range) {
    const Uplot = await loadUplot();
    this.info = info;
    this.data = data;
    this.range = range;
    if (data.dated === null) {
      this.destroy();
      fill(
        this.stack,
        h(
          "div",
          { class: "empty" },
          h("strong", null, "The time of the blocks is not known"),
          "Nothing dates or counts their files, so there is no axis of time. spallwatch check says what is missing; the values stand in the table below.",
        ),
      );
      return;
    }
    const specs = trendSpecs(info, data);
    const signature = JSON.stringify(
      [specs.map((spec) => [spec.name, spec.levels, spec.series.length, spec.wide && this.data.isWide(columnsOf(spec))]), colour("surface"), this.options.zone(), data.dated, info.marks],
    );
    const { time, places } = data.broken();
    this.places = places;
    if (signature !== this.signature) {
      this.destroy();
      this.signature = signature;
      this.charts = specs.map((spec) => this.make(Uplot, spec));
      fill(this.stack, this.charts.map((chart) => chart.element));
      this.charts.forEach((chart) => this.mount(Uplot, chart));
      this.addRug(Uplot);
    }
    for (const chart of this.charts) this.setData(chart, time, places);
    this.setRange(range);
    this.showValues(null);
  }

  make(Uplot, spec) {
    const legend = new Legend([
      ...spec.series,
      ...(spec.band && this.data.column(spec.band[0]) ? [{ label: spec.free ? "from least to highest in the block" : `${fmt.percent(this.info.interval)} interval`, colour: spec.series[0].colour, kind: "band" }] : []),
    ]);
    const unit = h("span", { class: "note" });
    const holder = h("div", { class: "plot" });
    const element = h(
      "div",
      { class: "trend", "data-chart": spec.name },
      h("div", { class: "trend-head" }, h("h3", null, spec.title), unit, legend.element, exportButtons(() => trendFile(this, spec))),
      holder,
    );
    const [name, divisor] = spec.duration ? fmt.durationUnit(this.data.span(columnsOf(spec))[1]) : [spec.unit, 1];
    setText(unit, name);
    return { spec, legend, holder, element, factor: 1 / divisor, log: spec.wide && this.data.isWide(columnsOf(spec)) };
  }

  mount(Uplot, chart) {
    const { spec } = chart;
    const series = [{}];
    const bands = [];
    if (spec.band) {
      const ink = spec.series[0].colour;
      const edge = { stroke: translucent(ink, 0.35), width: 1, points: { show: false }, gaps: this.gaps };
      series.push({ ...edge, label: "upper" }, { ...edge, label: "lower" });
      bands.push({ series: [1, 2], fill: translucent(ink, 0.16) });
    }
    for (const one of spec.series) {
      const at = series.length;
      const line = {
        stroke: colour(one.colour),
        width: 1.3,
        gaps: this.gaps,
        points: { show: this.showPoints, size: 4, fill: colour(one.colour) },
      };
      series.push({ ...line, label: `${one.label} max` }, { ...line, label: `${one.label} min`, points: { show: false } });
      bands.push({ series: [at, at + 1], fill: translucent(one.colour, 0.35) });
    }
    chart.plot = new Uplot(
      {
        width: this.width ?? 600, height: spec.height, series, bands, legend: { show: false },
        padding: [6, 14, 0, 0], tzDate: this.tzDate(Uplot),
        scales: { x: this.xScale(), y: { ...(chart.log ? { distr: 3 } : {}), range: (u, low, high) => this.yRange(chart, low, high) } },
        axes: [this.timeAxis(), chart.log ? { ...valueAxis((u, splits) => logLabels(splits)), filter: (u, splits) => splits } : valueAxis()],
        cursor: this.cursor(), select: { show: true },
        hooks: {
          draw: [(u) => this.drawOver(u, chart)],
          setCursor: [(u) => this.moved(u)],
          setSelect: [(u) => this.selected(u)],
        },
      },
      [[], ...series.slice(1).map(() => [])],
      chart.holder,
    );
  }

  gaps = (u, index, from, to, gaps) => gaps.filter(([a, b]) => u.posToVal(b, "x", true) - u.posToVal(a, "x", true) > 6 * this.data.step);

  showPoints = (u, index, from, to) => to - from < 60;

  tzDate(Uplot) {
    const zone = this.options.zone();
    return (time) => Uplot.tzDate(new Date(time * 1e3), zone === "UTC" ? "Etc/UTC" : zone);
  }

  xScale() {
    return { time: this.data.dated, auto: false, range: (u, low, high) => [low, high] };
  }

  timeAxis() {
    const options = { size: 26, space: 76 };
    const zone = this.options.zone();
    if (this.data.dated) options.values = (u, splits, index, space, step) => splits.map((time) => fmt.tick(time, step, zone));
    else {
      options.incrs = ELAPSED;
      options.values = (u, splits) => {
        const [name, divisor] = fmt.durationUnit(Math.max(...splits.map(Math.abs)));
        return splits.map((value) => `${fmt.number(value / divisor, 5)} ${name}`);
      };
    }
    return axis(options);
  }

  cursor() {
    return {
      y: false, sync: { key: SYNC, setSeries: false }, points: { size: 6 },
      drag: { x: true, y: false, setScale: false, dist: 6 },
      bind: { dblclick: () => () => this.options.onRange(null) },
    };
  }

  /** From nought, high enough for a level that is near; a level far above is an arrow. */
  yRange(chart, low, high) {
    if (chart.log) return fmt.isNumber(high) && high > 0 ? [Math.max(low, high * 1e-6) / 1.3, high * 1.3] : [0.1, 1];
    if (!fmt.isNumber(high)) return [0, 1];
    if (chart.spec.free) {
      const room = Math.max((high - low) * 0.15, Math.abs(high) * 0.01, 1e-9);
      return [low - room, high + room];
    }
    let top = high;
    for (const { value } of [...(chart.spec.lines ?? []), ...chart.spec.levels]) {
      const drawn = value * chart.factor;
      if (drawn > top && drawn < 2.5 * high) top = drawn;
    }
    return [Math.min(0, low), top * 1.1 || 1];
  }

  setData(chart, time, places) {
    const columns = [];
    const { spec, factor } = chart;
    const put = (name, side) => {
      const found = this.data.column(name);
      columns.push(found ? placed(found[side], places, factor) : new Array(time.length).fill(null));
    };
    if (spec.band) {
      put(spec.band[1], "high");
      put(spec.band[0], "low");
    }
    for (const one of spec.series) {
      put(one.column, "high");
      put(one.column, "low");
    }
    if (!chart.spec.series.length) columns.push(new Array(time.length).fill(null));
    chart.plot.setData([time, ...columns], false);
  }

  /** The blocks that were not simply accepted, as a row of marks below the charts. */
  addRug(Uplot) {
    const holder = h("div", { class: "plot" });
    const key = h(
      "div",
      { class: "legend" },
      h("span", { class: "item" }, h("i", { class: "swatch", "data-kind": "tick", "data-of": "rejected" }), "rejected"),
      h("span", { class: "item" }, h("i", { class: "swatch", "data-kind": "tick", "data-of": "flagged" }), "kept with a flag"),
    );
    this.stack.append(
      h("div", { class: "trend" }, h("div", { class: "trend-head" }, h("h3", null, "Rejected and flagged blocks"), key), holder),
    );
    const spec = { height: RUG_HEIGHT, series: [], levels: [] };
    const plot = new Uplot(
      {
        width: this.width ?? 600, height: RUG_HEIGHT, series: [
          {},
          { stroke: "transparent", points: { show: false } },
        ], legend: { show: false }, padding: [2, 14, 0, 0], tzDate: this.tzDate(Uplot),
        scales: { x: this.xScale(), y: { range: [0, 1] } },
        axes: [this.timeAxis(), valueAxis(() => [])], cursor: this.cursor(),
        hooks: { draw: [(u) => this.drawRug(u)], setCursor: [(u) => this.moved(u)], setSelect: [(u) => this.selected(u)] },
      },
      [[], []],
      holder,
    );
    const chart = { spec, plot, factor: 1, legend: new Legend([]) };
    this.charts.push(chart);
  }

  drawRug(u) {
    const { ctx, bbox } = u;
    ctx.save();
    const mark = (time, rejected) => {
      const x = u.valToPos(time, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.fillStyle = colour(rejected ? "danger" : "alert");
      const half = bbox.height / 2;
      ctx.fillRect(Math.round(x), bbox.top + (rejected ? 0 : half), Math.max(1, 1.5 * devicePixelRatio), half);
    };
    const { rejected, flagged } = this.data.columns;
    if (rejected || flagged) {
      this.data.time.forEach((time, i) => {
        if (flagged?.[i] > 0) mark(time, false);
        if (rejected?.[i] > 0) mark(time, true);
      });
    } else for (const block of this.blocks) if (fmt.isNumber(block.time_s)) mark(block.time_s, block.rejected);
    ctx.restore();
  }

  setBlocks(blocks) {
    this.blocks = blocks;
    this.charts.at(-1)?.plot.redraw(false);
  }

  drawOver(u, chart) {
    const { marks } = this.info;
    const taken = [];
    // Marks near the right edge have their words there; levels are then named at the left one.
    const edge = u.bbox.left + u.bbox.width - 170 * devicePixelRatio;
    const atLeft = [marks?.t_fs_s, marks?.t_eol_s].some(
      (time) => fmt.isNumber(time) && u.valToPos(time, "x", true) > edge && time <= u.scales.x.max,
    );
    for (const { value, label, colour: name } of [...(chart.spec.lines ?? []), ...chart.spec.levels])
      horizontalLine(u, value * chart.factor, { stroke: colour(name), label, taken, atLeft });
    const named = chart.spec.marks ? (text) => text : () => "";
    const line = colour("mark");
    if (fmt.isNumber(marks?.t_fs_s)) verticalLine(u, marks.t_fs_s, { stroke: line, width: 1.5, label: named("final stage began") });
    if (fmt.isNumber(marks?.t_fs_known_s) && marks.t_fs_known_s !== marks.t_fs_s) verticalLine(
      u,
      marks.t_fs_known_s,
      { stroke: line, dash: [2, 3], label: named("known"), row: 1 },
    );
    if (fmt.isNumber(marks?.t_eol_s)) verticalLine(
      u,
      marks.t_eol_s,
      { stroke: colour("failure"), width: 1.5, label: named("end of life"), row: 2 },
    );
  }

  /** Show a stretch of time on all charts. */
  setRange([min, max]) {
    if (!fmt.isNumber(min) || !fmt.isNumber(max)) return;
    if (max <= min) max = min + 1;
    this.range = [min, max];
    for (const { plot } of this.charts) plot.setScale("x", { min, max });
  }

  selected(u) {
    if (u.select.width < 4 || this.busy) return;
    this.busy = true;
    const from = u.posToVal(u.select.left, "x");
    const to = u.posToVal(u.select.left + u.select.width, "x");
    for (const { plot } of this.charts) plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.busy = false;
    this.options.onRange(from, to);
  }

  moved(u) {
    if (u.cursor.event || u.cursor.left >= 0 || this.cursorAt !== null) {
      const index = u.cursor.left >= 0 ? u.cursor.idx : null;
      if (index === this.cursorAt) return;
      this.cursorAt = index;
      this.showValues(index);
    }
  }

  /** Values at the cursor; the latest ones where it is elsewhere. */
  showValues(index) {
    if (!this.data) return;
    const place = index === null || index === undefined ? null : this.places[index];
    const at = place === null || place < 0 ? null : place;
    const time = at === null ? this.data.time.at(-1) : this.data.time[at];
    setText(
      this.when,
      fmt.isNumber(
        time,
      ) ? `${at === null ? "latest: " : ""}${fmt.moment(time, { dated: this.data.dated, zone: this.options.zone() })}` : "",
    );
    this.options.onCursor?.(at === null ? null : time);
    for (const { spec, legend } of this.charts) {
      const show = spec.duration ? fmt.duration : fmt.number;
      const texts = spec.series.map((one) => this.valueAt(one.column, at, show));
      if (spec.band) texts.push(fmt.interval(this.edge(spec.band[0], "low", at), this.edge(spec.band[1], "high", at), show));
      legend.show(texts);
    }
  }

  edge(name, side, at) {
    const values = this.data.column(name)?.[side];
    return values ? (at === null ? values.findLast(fmt.isNumber) : values[at]) : null;
  }

  valueAt(name, at, show) {
    const low = this.edge(name, "low", at);
    const high = this.edge(name, "high", at);
    if (!fmt.isNumber(high)) return fmt.MISSING;
    return low === high ? show(high) : fmt.interval(low, high, show);
  }

  wheel(event) {
    if (!event.ctrlKey && !event.metaKey && !event.shiftKey) return;
    const plot = event.target.closest(".uplot");
    const chart = this.charts.find((one) => one.plot.root === plot);
    if (!chart) return;
    event.preventDefault();
    const x = event.clientX - chart.plot.over.getBoundingClientRect().left;
    this.zoom((event.deltaY || event.deltaX) < 0 ? 0.75 : 4 / 3, chart.plot.posToVal(x, "x"));
  }

  zoom(factor, around = null) {
    const [from, to] = this.range;
    const middle = around ?? (from + to) / 2;
    this.options.onRange(middle - (middle - from) * factor, middle + (to - middle) * factor);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !this.range) return;
    const [from, to] = this.range;
    const step = (to - from) / 5;
    const actions = {
      "+": () => this.zoom(0.6), "=": () => this.zoom(0.6), "-": () => this.zoom(1 / 0.6), 0: () => this.options.onRange(null),
      ArrowLeft: () => this.options.onRange(from - step, to - step), ArrowRight: () => this.options.onRange(from + step, to + step),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  resize(width) {
    this.width = width;
    for (const { plot, spec } of this.charts) plot.setSize({ width, height: spec.height });
  }

  destroy() {
    for (const { plot } of this.charts) plot.destroy();
    this.charts = [];
    this.signature = null;
    this.cursorAt = null;
  }

  close() {
    this.stop();
    this.destroy();
  }
}

