// What the files of a trend hold.

import * as fmt from "./fmt.js";

export const columnsOf = (spec) => [...spec.series.map((one) => one.column), ...(spec.band ?? [])];

/** A chart of the trends for exportButtons(): the greatest value of each point, in the unit of the chart. */
export function trendFile({ options, charts, data, range }, spec) {
  const chart = charts.find((one) => one.spec === spec);
  if (!chart?.plot || !data.size) return null;
  const unit = spec.duration ? fmt.durationUnit(1 / chart.factor)[0] : spec.unit;
  const values = (name) => data.column(name).high.map((value) => (fmt.isNumber(value) ? value * chart.factor : null));
  const names = columnsOf(spec).filter((name) => data.column(name));
  const time = `time, ${data.dated ? "UTC seconds since 1970" : "s after the first block"}`;
  const { machine, channel } = options;
  return {
    name: `${machine}-${channel}-${spec.name}`,
    title: `${spec.title}${unit ? `, ${unit}` : ""}; ${machine}, ${channel}`,
    x: time,
    y: unit ?? "",
    log: chart.log,
    range,
    canvas: chart.plot.ctx.canvas,
    columns: [[time, data.time], ...names.map((name) => [name, values(name)])],
  };
}
