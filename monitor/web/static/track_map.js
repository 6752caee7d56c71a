// The RMS map of a channel with the way that the equivalent defect took on it.

import { channelPath, get } from "./api.js";
import { Board, colourLegend, picture, ticks } from "./canvas.js";
import { figure, onWidth, sayInstead, translucent } from "./chart.js";
import { fill, h, setText } from "./dom.js";
import { exportButtons } from "./exporting.js";
import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";

const HEIGHT = 320;
const LEVELS = 7;

/** Line segments along which a table (rows over y, columns over x) has a level: marching squares. */
export function contour(x, y, values, level) {
  const segments = [];
  const cross = (x0, y0, v0, x1, y1, v1) => {
    const share = (level - v0) / (v1 - v0);
    return [x0 + share * (x1 - x0), y0 + share * (y1 - y0)];
  };
  for (let j = 0; j + 1 < y.length; j += 1)
    for (let i = 0; i + 1 < x.length; i += 1) {
      const corners = [
        [x[i], y[j], values[j][i]],
        [x[i + 1], y[j], values[j][i + 1]],
        [x[i + 1], y[j + 1], values[j + 1][i + 1]],
        [x[i], y[j + 1], values[j + 1][i]],
      ];
      if (corners.some((corner) => !fmt.isNumber(corner[2]))) continue;
      const points = [];
      for (let k = 0; k < 4; k += 1) {
        const [a, b] = [corners[k], corners[(k + 1) % 4]];
        if (a[2] >= level !== b[2] >= level) points.push(cross(...a, ...b));
      }
      for (let k = 0; k + 1 < points.length; k += 2) segments.push([points[k], points[k + 1]]);
    }
  return segments;
}

const sentence = (text) => `${text.charAt(0).toUpperCase()}${text.slice(1)}${text.endsWith(".") ? "" : "."}`;

export class TrackMap {
  /** @param options machine, channel, zone(), info() */
  constructor(options) {
    this.options = options;
    const box = figure("Track on the RMS map");
    this.element = box.element;
    this.body = box.body;
    this.caption = h("span", { class: "note" });
    this.legend = h("span");
    this.readout = h("span", { class: "note readout" });
    this.board = new Board("RMS map");
    this.board.canvas.addEventListener("pointermove", (event) => this.moved(event));
    this.board.canvas.addEventListener("pointerleave", () => setText(this.readout, ""));
    this.content = [
      h("div", { class: "under-head" }, this.legend, this.readout),
      this.board.canvas,
      h("div", { class: "controls" }, exportButtons(() => this.file(), ["PNG", "CSV"])),
      this.caption,
    ];
    this.stop = onWidth(this.body, (width) => {
      this.width = width;
      this.draw();
    });
  }

  /** What the files hold: the picture, and the track. */
  file() {
    const track = this.data?.track;
    if (!this.data) return null;
    const { machine, channel } = this.options;
    return {
      name: `${machine}-${channel}-map`,
      title: `Track on the RMS map; ${machine}, ${channel}`,
      canvas: this.board.canvas,
      columns: [
        ["time, s", track?.time_s ?? []],
        ["extent, degrees", track?.dphi_deg ?? []],
        ["depth, µm", track?.h_d_um ?? []],
        ["V_eq, mm³/mm", track?.v_eq_mm2 ?? []],
      ],
    };
  }

  async load() {
    let data;
    try {
      data = await get(`${channelPath(this.options.machine, this.options.channel)}/map`);
    } catch (error) {
      sayInstead(this.body, `The map could not be read: ${error.message}`, () => this.load());
      return;
    }
    if (!data.rms_g) {
      this.data = null;
      sayInstead(this.body, sentence(data.reason ?? "this channel has no map"));
      return;
    }
    const axes = (found) => JSON.stringify([found.fault, found.dphi_deg]);
    const same = this.data && axes(this.data) === axes(data);
    this.data = data;
    if (!same) this.image = null;
    fill(this.body, this.content);
    this.draw();
  }

  range() {
    const all = this.data.rms_g.flat().filter((value) => value > 0);
    return [Math.min(...all), Math.max(...all)];
  }

  draw() {
    if (!this.data || !this.width) return;
    const { board, data } = this;
    const [low, high] = this.range();
    const share = (value) => (fmt.isNumber(value) ? Math.sqrt(Math.max(0, value - low) / (high - low || 1)) : NaN);
    this.image ??= picture(this.resampled().map((row) => row.map(share)).reverse());
    const context = board.begin(this.width, HEIGHT, { bottom: 42 });
    const { left, top, width, height } = board.plot;
    context.imageSmoothingEnabled = true;
    context.drawImage(this.image, left, top, width, height);
    const [x0, x1] = [data.dphi_deg[0], data.dphi_deg.at(-1)];
    const [y0, y1] = [data.h_d_um[0], data.h_d_um.at(-1)];
    const x = (value) => left + (width * (value - x0)) / (x1 - x0 || 1);
    const y = (value) => top + height - (height * (value - y0)) / (y1 - y0 || 1);
    for (const level of ticks(low, high, LEVELS)) {
      const ink = translucent(share(level) > 0.55 ? "surface" : "text", 0.55);
      for (const segment of contour(data.dphi_deg, data.h_d_um, data.rms_g, level)) board.line(
        segment.map(([a, b]) => [x(a), y(b)]),
        ink,
        { width: 0.8 },
      );
    }
    board.frame();
    board.bottomAxis(ticks(x0, x1, width / 80).map((value) => [value, fmt.number(value)]), x, "extent of the damage, degrees");
    board.leftAxis(ticks(y0, y1, 6).map((value) => [value, fmt.number(value)]), y, "depth, µm");
    this.drawTrack(x, y);
    fill(this.legend, colourLegend(fmt.level(low, "g"), fmt.level(high, "g"), "RMS"));
    this.say();
  }

  /** The map on an even grid: its own may be finer where it matters. */
  resampled() {
    const { dphi_deg: xs, h_d_um: ys, rms_g: values } = this.data;
    const even = (ends, many) => Array.from({ length: many }, (_, i) => ends[0] + ((ends.at(-1) - ends[0]) * i) / (many - 1));
    const place = (axis, value) => {
      let i = 0;
      while (i + 2 < axis.length && axis[i + 1] < value) i += 1;
      return [i, axis.length > 1 ? (value - axis[i]) / (axis[i + 1] - axis[i]) : 0];
    };
    const columns = even(xs, 120).map((value) => place(xs, value));
    return even(ys, 80).map((value) => {
      const [j, b] = place(ys, value);
      const next = Math.min(j + 1, ys.length - 1);
      return columns.map(([i, a]) => {
        const right = Math.min(i + 1, xs.length - 1);
        return (1 - b) * ((1 - a) * values[j][i] + a * values[j][right]) + b * ((1 - a) * values[next][i] + a * values[next][right]);
      });
    });
  }

  drawTrack(x, y) {
    const track = this.data.track ?? {};
    const points = (track.time_s ?? []).map(
      (time, i) => [time, track.dphi_deg[i], track.h_d_um[i]],
    ).filter((point) => point.every(fmt.isNumber));
    this.points = points.map(([time, a, b], i) => ({ time, x: x(a), y: y(b), dphi: a, h_d: b, index: i }));
    const first = points[0]?.[0];
    const last = points.at(-1)?.[0];
    const ink = (time) => `color-mix(in oklab, ${colour("path")} ${Math.round(35 + (65 * (time - first)) / (last - first || 1))}%, ${colour("surface")})`;
    const { board } = this;
    board.line(this.points.map((point) => [point.x, point.y]), colour("surface"), { width: 4.5 });
    for (let i = 1; i < this.points.length; i += 1)
      board.line([this.points[i - 1], this.points[i]].map((point) => [point.x, point.y]), ink(this.points[i].time), { width: 2.5 });
    const end = this.points.at(-1);
    if (!end) return;
    const { context } = board;
    context.beginPath();
    context.arc(end.x, end.y, 5, 0, 2 * Math.PI);
    context.fillStyle = colour("path");
    context.strokeStyle = colour("surface");
    context.lineWidth = 2;
    context.fill();
    context.stroke();
  }

  say() {
    const { data } = this;
    const end = this.points.at(-1);
    const where = end ? `Now ${fmt.number(end.dphi)}° by ${fmt.number(end.h_d)} µm, from the pale to the full end of the path.` : "Nothing is tracked yet.";
    const condition = [
      fmt.isNumber(data.load_newton) && `${fmt.number(data.load_newton, 4)} N`,
      fmt.isNumber(data.speed_hz) && fmt.hertz(data.speed_hz),
    ].filter(Boolean).join(", ");
    const every = ticks(...this.range(), LEVELS);
    const at = condition ? ` Map at ${condition}.` : "";
    const calibrated = data.calibrated ? "" : " The rig is not calibrated: sizes are on the scale of the model.";
    const text = `${where} Contours every ${fmt.number(every[1] - every[0])} g.${at}${calibrated}`;
    setText(this.caption, text);
    this.board.canvas.setAttribute("aria-label", `RMS map over extent and depth of the damage. ${text}`);
  }

  moved(event) {
    if (!this.points?.length) return;
    const box = this.board.canvas.getBoundingClientRect();
    const at = [event.clientX - box.left, event.clientY - box.top];
    const distance = (point) => Math.hypot(point.x - at[0], point.y - at[1]);
    const near = this.points.reduce((best, point) => (distance(point) < distance(best) ? point : best));
    if (distance(near) > 24) return setText(this.readout, "");
    const info = this.options.info();
    setText(
      this.readout,
      `${fmt.moment(near.time, { dated: info?.dated, zone: this.options.zone() })}: ${fmt.number(near.dphi)}°, ${fmt.number(near.h_d)} µm`,
    );
  }

  /** Another theme. */
  redraw() {
    this.image = null;
    this.draw();
  }

  close() {
    this.stop();
  }
}
