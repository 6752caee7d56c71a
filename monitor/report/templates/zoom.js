// Figures over time become charts that can be zoomed. Where this does not run, and on paper, the pictures stand.
(() => {
  "use strict";
  const FONT = '11px system-ui, -apple-system, "Segoe UI", "DejaVu Sans", Arial, sans-serif';
  const NARROWEST = 4;
  const DASHES = { "-": [], "--": [6, 4], ":": [2, 3], "-.": [7, 3, 2, 3], dashed: [6, 4] };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const known = (value) => typeof value === "number" && Number.isFinite(value);
  const number = (value, digits = 4) => String(Number(value.toPrecision(digits)));

  function h(tag, attributes, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(...children);
    return element;
  }

  /** A colour of the theme, let through. */
  function faint(name, share) {
    const whole = colour(name);
    return /^#[0-9a-f]{6}$/i.test(whole) ? whole + Math.round(share * 255).toString(16).padStart(2, "0") : whole;
  }

  /** Dates in the zone of the report, as its tables write them. */
  class Dates {
    constructor(zone) {
      this.zone = zone;
      this.format = new Intl.DateTimeFormat("en-GB", {
        timeZone: zone, hourCycle: "h23", year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit",
      });
    }

    parts(seconds) {
      const found = {};
      for (const { type, value } of this.format.formatToParts(seconds * 1e3)) found[type] = value;
      return { day: `${found.year}-${found.month}-${found.day}`, time: `${found.hour}:${found.minute}`, second: found.second };
    }

    whole(seconds) {
      const { day, time, second } = this.parts(seconds);
      return `${day} ${time}:${second} ${this.zone}`;
    }

    /** Labels of an axis: times, and below them the date wherever it is another than before. */
    labels(moments, step) {
      let before = "";
      return moments.map((moment) => {
        const { day, time, second } = this.parts(moment);
        const date = day === before ? "" : day;
        before = day;
        if (step >= 86400) return date;
        return (step >= 60 ? time : `${time}:${second}`) + (date && `\n${date}`);
      });
    }
  }

  /** Steps of a logarithmic axis: one, two and five, powers of ten alone where there are many, even steps where few. */
  function ladder(low, high) {
    const found = [];
    const wide = Math.log10(high / low) > 3.5;
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
      for (const step of wide ? [1] : [1, 2, 5]) {
        const value = Number(`${step}e${power}`);
        if (value >= low && value <= high) found.push(value);
      }
    if (found.length > 2) return found;
    const room = (high - low) / 4;
    const power = 10 ** Math.floor(Math.log10(room));
    const step = power * [1, 2, 5, 10].find((times) => times * power >= room);
    const first = Math.ceil(low / step);
    return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, at) => Number(((first + at) * step).toPrecision(12)));
  }

  /** The charts of one figure, on one axis of time. */
  class Zoom {
    constructor(figure, order) {
      this.order = order;
      this.data = JSON.parse(figure.querySelector("script").textContent);
      const picture = figure.querySelector(".wide");
      const height = picture.getBoundingClientRect().height;
      const label = picture.querySelector("svg")?.getAttribute("aria-label") ?? "";
      let at = this.data.start;
      const { dated, unit, zone } = this.data;
      this.place = (seconds) => (dated ? seconds : seconds / unit);
      this.x = [at, ...this.data.steps.map((step) => (at += step))].map(this.place);
      this.all = [this.x[0], this.x.at(-1)];
      this.dates = dated ? new Dates(zone) : null;
      this.when = h("span", { class: "when" });
      this.least = Math.max((this.all[1] - this.all[0]) * 1e-5, NARROWEST * this.usualStep());
      const button = (text, name, act) => {
        const made = h("button", { type: "button", "aria-label": name, title: name }, text);
        made.addEventListener("click", act);
        return made;
      };
      this.back = button("all", "Show all", () => this.show(this.all));
      this.stack = h("div", { role: "img", "aria-label": label });
      this.element = h(
        "div",
        { class: "zoom", tabindex: "0", role: "group", "aria-label": "Zoom: drag, or plus and minus; arrows move, Escape shows all" },
        h("div", { class: "bar" }, this.when, button("−", "Zoom out", () => this.by(1 / 0.6)), button("+", "Zoom in", () => this.by(0.6)), this.back),
        this.stack,
      );
      this.element.addEventListener("keydown", (event) => this.key(event));
      figure.insertBefore(this.element, picture.nextSibling);
      figure.classList.add("live");
      this.build(height);
      this.show(this.all);
      this.values(null);
      new ResizeObserver(() => this.resize()).observe(this.stack);
    }

    usualStep() {
      const steps = this.data.steps.filter((step) => step > 0).sort((a, b) => a - b);
      return this.place(steps[steps.length >> 1] ?? 1);
    }

    build(height) {
      const { panels } = this.data;
      const share = panels.reduce((sum, panel) => sum + panel.height, 0);
      const room = Math.max(height - 28 - 20 * panels.length - 30, 120 * panels.length);
      this.charts = panels.map((panel, index) => {
        const last = index === panels.length - 1;
        const key = h("div", { class: "key" }, ...this.keys(panel, index));
        const holder = h("div", {});
        this.stack.append(key, holder);
        const tall = Math.round((room * panel.height) / share) + (last ? 30 : 0);
        return { plot: this.plot(panel, index, holder, tall, last), key, tall, panel };
      });
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.charts.forEach(({ plot }) => plot.redraw(false)));
    }

    /** Names and signs of all that a chart shows; values of lines follow the cursor. */
    keys(panel, index) {
      const item = (kind, name, text, value) => {
        const sign = h("i", { class: kind });
        sign.style.setProperty("--colour", `var(--${name})`);
        return h("span", {}, sign, text, ...(value ? [" ", value] : []));
      };
      const found = panel.bands.map((band) => item("band", band.colour, band.label));
      panel.lines.forEach((line) => found.push(item(line.kind, line.colour, line.label, (line.value = h("b", {})))));
      panel.levels.slice(0, 1).forEach((level) => found.push(item("dashed", level.colour, level.label)));
      if (index === 0) {
        this.data.marks.forEach((mark) => found.push(item(mark.style === ":" ? "dotted" : "line", mark.colour, mark.label)));
        this.data.ticks.forEach((tick) => found.push(item("tick", tick.colour, `${tick.label} (${tick.all})`)));
      }
      return found;
    }

    plot(panel, index, holder, height, last) {
      const column = (place) => this.data.columns[place];
      const series = [{}];
      const values = [this.x];
      const bands = [];
      for (const band of panel.bands) {
        for (const place of [band.columns[1], band.columns[0]]) {
          series.push({ stroke: () => faint(band.colour, 0.5), width: 1, points: { show: false } });
          values.push(column(place));
        }
        bands.push({ series: [series.length - 2, series.length - 1], fill: () => faint(band.colour, 0.26) });
      }
      for (const line of panel.lines) {
        const own = column(line.column);
        const alone = own.flatMap((value, at) => (known(value) && !known(own[at - 1]) && !known(own[at + 1]) ? [at] : []));
        const dots = line.kind === "dots";
        series.push({
          stroke: () => colour(line.colour), width: 1.3, dash: DASHES[line.kind] ?? [], ...(dots ? { paths: () => null } : {}),
          points: {
            show: (u, which, from, to) => dots || to - from < 60, size: 4, width: 0, fill: () => colour(line.colour),
            filter: (u, which, show) => (show ? null : alone),
          },
        });
        values.push(own);
      }
      const made = new uPlot(
        {
          width: this.width(), height, series, bands, legend: { show: false }, padding: [6, 10, 0, 0],
          tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1e3), this.data.zone === "UTC" ? "Etc/UTC" : this.data.zone),
          scales: {
            x: { time: this.data.dated, auto: false, range: (u, low, high) => [low, high] },
            y: { distr: panel.log ? 3 : 1, range: (u, low, high) => this.span(panel, low, high) },
          },
          axes: [this.across(last), this.upright(panel)],
          cursor: {
            y: false, points: { size: 6 }, sync: { key: `zoom-${this.order}`, setSeries: false }, drag: { x: true, y: false, setScale: false, dist: 5 },
            bind: { dblclick: () => () => this.show(this.all) },
          },
          hooks: {
            drawClear: [(u) => this.under(u)],
            draw: [(u) => this.over(u, panel, index)],
            setCursor: [(u) => u.cursor.left !== undefined && this.values(u.cursor.left >= 0 ? u.cursor.idx : null)],
            setSelect: [(u) => this.selected(u)],
          },
        },
        values,
        holder,
      );
      return made;
    }

    width() {
      return Math.max(260, Math.floor(this.stack.getBoundingClientRect().width));
    }

    across(last) {
      const axis = {
        stroke: () => colour("soft"), font: FONT, labelFont: FONT, gap: 4, space: 84, grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false },
      };
      if (!last) return { ...axis, size: 6, values: (u, splits) => splits.map(() => "") };
      if (this.dates) return { ...axis, size: 46, values: (u, splits, which, space, step) => this.dates.labels(splits, step) };
      return { ...axis, size: 26, label: this.data.label, labelSize: 20, labelGap: 0, values: (u, splits) => splits.map((value) => number(value, 6)) };
    }

    upright(panel) {
      return {
        stroke: () => colour("soft"), font: FONT, labelFont: FONT, gap: 4, size: 46, label: panel.label, labelSize: 18, labelGap: 0, space: 26,
        grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false }, values: (u, splits) => splits.map((value) => (known(value) ? number(value) : "")),
        ...(panel.log ? { splits: (u, which, low, high) => ladder(low, high), filter: (u, splits) => splits } : {}),
      };
    }

    /** Ends of a vertical axis: those of what is in sight, with the levels that are near. */
    span(panel, low, high) {
      if (!known(low) || !known(high)) return panel.log ? [0.1, 1] : [0, 1];
      for (const { value } of panel.levels) {
        if (value > high && value < 2.5 * high) high = value;
        if (panel.log && value > 0 && value < low && value > low / 2.5) low = value;
      }
      if (panel.log) {
        const margin = Math.max((high / low) ** 0.06, 1.005);
        return [low / margin, high * margin];
      }
      return [Math.min(0, low), Math.min(1.08 * high, panel.top ?? Infinity) || 1];
    }

    under(u) {
      if (this.data.shade.length < 2) return;
      const [from, to] = this.data.shade.map((at) => u.valToPos(this.place(at), "x", true));
      const { left, top, width, height } = u.bbox;
      const [a, b] = [Math.max(from, left), Math.min(to, left + width)];
      if (b <= a) return;
      u.ctx.fillStyle = colour("shade");
      u.ctx.fillRect(a, top, b - a, height);
    }

    over(u, panel, index) {
      const { ctx, bbox } = u;
      const scale = devicePixelRatio;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      const stroke = (name, dash, x1, y1, x2, y2) => {
        ctx.strokeStyle = colour(name);
        ctx.lineWidth = 1.2 * scale;
        ctx.setLineDash(dash.map((length) => length * scale));
        ctx.beginPath();
        ctx.moveTo(x1, y1);
        ctx.lineTo(x2, y2);
        ctx.stroke();
      };
      for (const { value, colour: name } of panel.levels) {
        const y = u.valToPos(value, "y", true);
        stroke(name, DASHES["--"], bbox.left, y, bbox.left + bbox.width, y);
      }
      for (const { at, colour: name, style } of this.data.marks) {
        const x = u.valToPos(this.place(at), "x", true);
        stroke(name, DASHES[style] ?? [], x, bbox.top, x, bbox.top + bbox.height);
      }
      if (index === 0)
        for (const { at, colour: name, top } of this.data.ticks)
          for (const one of at) {
            const x = u.valToPos(this.place(one), "x", true);
            const end = top ? bbox.top : bbox.top + bbox.height;
            stroke(name, [], x, end, x, end + (top ? 8 : -8) * scale);
          }
      ctx.restore();
    }

    /** Show values at a block, or none. */
    values(at) {
      const somewhere = known(at);
      if (somewhere) this.when.textContent = this.dates ? this.dates.whole(this.x[at]) : `${number(this.x[at], 6)} ${this.data.label}`;
      else this.when.textContent = "Drag to zoom; double click or Escape shows all";
      for (const { panel } of this.charts ?? [])
        for (const line of panel.lines) {
          const value = somewhere ? this.data.columns[line.column][at] : null;
          line.value.textContent = known(value) ? number(value, 3) : "";
        }
    }

    selected(u) {
      const { left, width } = u.select;
      if (width < 4 || this.busy) return;
      this.busy = true;
      const range = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
      for (const { plot } of this.charts) plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      this.busy = false;
      this.show(range);
    }

    /** Show a stretch, inside of all there is and not narrower than a few blocks. */
    show([from, to]) {
      const [first, last] = this.all;
      const wide = Math.min(Math.max(to - from, this.least), last - first);
      const begin = Math.min(Math.max((from + to - wide) / 2, first), last - wide);
      this.range = [begin, begin + wide];
      this.back.disabled = wide >= last - first;
      this.element.dataset.from = begin;
      this.element.dataset.to = begin + wide;
      for (const { plot } of this.charts) plot.setScale("x", { min: begin, max: begin + wide });
    }

    by(factor) {
      const [from, to] = this.range;
      const [middle, half] = [(from + to) / 2, ((to - from) / 2) * factor];
      this.show([middle - half, middle + half]);
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const [from, to] = this.range;
      const step = (to - from) / 5;
      const actions = {
        "+": () => this.by(0.6), "=": () => this.by(0.6), "-": () => this.by(1 / 0.6), 0: () => this.show(this.all), Escape: () => this.show(this.all),
        ArrowLeft: () => this.show([from - step, to - step]), ArrowRight: () => this.show([from + step, to + step]),
      };
      if (!actions[event.key]) return;
      event.preventDefault();
      actions[event.key]();
    }

    resize() {
      const width = this.width();
      for (const { plot, tall } of this.charts) if (plot.width !== width) plot.setSize({ width, height: tall });
    }
  }

  // A page may hold a hundred figures: each is drawn when it comes near.
  let order = 0;
  const near = new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        near.unobserve(target);
        new Zoom(target, (order += 1));
      }
    },
    { rootMargin: "400px" },
  );
  for (const data of document.querySelectorAll('figure > script[type="application/json"]')) near.observe(data.parentElement);
})();
