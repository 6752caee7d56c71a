// Which trends are drawn, and how.

import * as fmt from "./fmt.js";
import { CHARTS, FEATURES } from "./words.js";

const LAYOUT = {
  rms: { height: 150, marks: true },
  lines: { height: 150, wide: true },
  v_eq: { height: 150 },
  v_eq_relative: { height: 150 },
  tt: { height: 150, duration: true },
  speed: { height: 104 },
  load: { height: 84 },
};
const COLOURS = {
  rms_smoothed: "series-two", h_or: "outer", h_ir: "inner", h_ball: "ball", h_cage: "cage", speed: "shaft", load: "shaft",
};
const isBound = (name) => /_(lower|upper|min|max)$/.test(name);

/** Charts of a channel, given what is known of it and which columns hold anything. */
export function trendSpecs(info, data) {
  const left = leftOut(info);
  return Object.keys(CHARTS)
    .filter((chart) => chart !== left)
    .map((chart) => specOf(chart, info))
    .map((spec) => ({ ...spec, series: spec.series.filter((series) => data.column(series.column) !== null) }))
    .filter((spec) => spec.series.length && !(spec.free && data.constant([spec.series[0].column, ...(spec.band ?? [])]) !== null))
    .map((spec) => ({ ...spec, levels: levelsOf(info, spec) }));
}

/** V_eq itself where it cannot be compared with a volume, else the relative one. */
function leftOut(info) {
  return info.calibrated === false && !info.thresholds_mm2?.length ? "v_eq" : "v_eq_relative";
}

/** One chart with the features that the table puts into it. */
function specOf(chart, info) {
  const drawn = Object.entries(FEATURES).filter(([, feature]) => feature.chart === chart);
  const [, first] = drawn[0];
  const bounds = drawn.filter(([name]) => isBound(name)).map(([, feature]) => feature.column);
  const unit = CHARTS[chart].unit ?? (first.acceleration ? fmt.levelUnit(info.unit) : first.unit);
  const lines = (info.thresholds_mm2 ?? []).map(
    (value) => ({ value, label: `threshold ${fmt.number(value)}`, colour: "danger" }),
  );
  return {
    name: chart,
    title: CHARTS[chart].title,
    unit: LAYOUT[chart]?.duration ? undefined : unit,
    height: 96,
    ...LAYOUT[chart],
    free: first.axis === "free" || undefined,
    series: drawn
      .filter(([name]) => !isBound(name))
      .map(([name, feature]) => ({ column: feature.column, label: feature.label, colour: COLOURS[name] ?? "series" })),
    band: bounds.length ? bounds : undefined,
    lines: chart === "v_eq" ? lines : chart === "velocity" ? zoneLines(info) : undefined,
  };
}

/** Limits between the zones of the machine's class. */
function zoneLines(info) {
  const names = ["A/B", "B/C", "C/D"];
  return (info.iso_class?.limits_mm_s ?? []).map((value, index) => ({ value, label: `${names[index]} ${fmt.number(value)}`, colour: "axis" }));
}

/** Alarm levels that belong into a chart; learned ones appear once they are known. */
function levelsOf(info, spec) {
  const found = [];
  for (const level of info.levels ?? []) {
    if (!spec.series.some((series) => series.column === level.column) && !spec.band?.includes(level.column)) continue;
    const show = spec.duration ? fmt.duration : fmt.number;
    for (const severity of ["alert", "danger"]) {
      const value = level[severity];
      if (fmt.isNumber(value)) found.push({ value, label: `${severity} ${show(value)}`, colour: severity });
    }
  }
  return found;
}
