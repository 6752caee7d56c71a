// Which trends are drawn, and how.

import * as fmt from "./fmt.js";
import { PARTS, PART_NAMES } from "./words.js";

const H_COLUMNS = { outer: "h_or_g", inner: "h_ir_g", ball: "h_ball_g", cage: "h_cage_g" };

/** Charts of a channel, given what is known of it and which columns hold anything. */
export function trendSpecs(info, data) {
  const unit = fmt.levelUnit(info.unit);
  const has = (name) => data.column(name) !== null;
  const specs = [
    {
      name: "rms", title: "Vibration, RMS", unit, height: 150, columns: ["rms_g", "rms_smoothed_g"],
      series: [
        { column: "rms_g", label: "RMS", colour: "series" },
        { column: "rms_smoothed_g", label: "smoothed", colour: "series-two" },
      ],
      marks: true,
    },
    {
      name: "lines", title: "Lines of the damaged parts in the envelope spectrum", unit, height: 150,
      series: PARTS.map((part) => ({ column: H_COLUMNS[part], label: PART_NAMES[part], colour: part })),
    },
    {
      name: "kurtosis",
      title: "Kurtosis",
      unit: "3 for a healthy bearing's noise",
      height: 96,
      series: [{ column: "kurtosis", label: "kurtosis", colour: "series" }],
    },
    { name: "peak", title: "Peak", unit, height: 96, series: [{ column: "peak_g", label: "peak", colour: "series" }] },
    {
      name: "v_eq", title: "Damaged volume V_eq", unit: "mm³ per mm of width", height: 150,
      series: [{ column: "v_eq_mm2", label: "V_eq", colour: "series" }],
      band: ["v_eq_lower_mm2", "v_eq_upper_mm2"],
      lines: (info.thresholds_mm2 ?? []).map((value) => ({ value, label: `threshold ${fmt.number(value)}`, colour: "danger" })),
    },
    {
      name: "tt", title: "Time to threshold", duration: true, height: 150,
      series: [{ column: "tt_s", label: "time left", colour: "series" }],
      band: ["tt_lower_s", "tt_upper_s"],
    },
  ];
  if (data.constant("speed_hz") === null)
    specs.push(
      {
        name: "speed",
        title: "Shaft speed",
        unit: "Hz",
        height: 84,
        free: true,
        series: [{ column: "speed_hz", label: "speed", colour: "shaft" }],
      },
    );
  if (data.constant("load_newton") === null)
    specs.push(
      {
        name: "load",
        title: "Load",
        unit: "N",
        height: 84,
        free: true,
        series: [{ column: "load_newton", label: "load", colour: "shaft" }],
      },
    );
  return specs
    .map((spec) => ({ ...spec, series: spec.series.filter((series) => has(series.column)) }))
    .filter((spec) => spec.series.length)
    .map((spec) => ({ ...spec, levels: levelsOf(info, spec) }));
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
