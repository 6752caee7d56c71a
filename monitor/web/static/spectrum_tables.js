// What the tables and the files of a spectrum hold.

import * as fmt from "./fmt.js";
import { colour } from "./prefs.js";
import { amplitudeAt, amplitudeText, decibel, lineNear, unitText } from "./spectral.js";
import { PART_NAMES } from "./words.js";

const place = (trace, frequency, figures) => [
  fmt.hertz(frequency, figures),
  fmt.isNumber(trace.speed_hz) ? fmt.number(frequency / trace.speed_hz, 4) : fmt.MISSING,
];

/** The highest peaks in the range that is shown. */
export function peakRows(plot) {
  const { trace } = plot;
  const lines = plot.allLines();
  return plot.shownPeaks().map(({ frequency, amplitude }, index) => [
    String(index + 1),
    ...place(trace, frequency, 6),
    amplitudeText(amplitude, trace),
    `${fmt.number(decibel(amplitude, trace), 4)} dB`,
    lineNear(lines, frequency, trace.resolution)?.name ?? "",
  ]);
}

/** The amplitudes at lines of the parts. */
export const lineRows = (trace, lines) => lines.map((line) => [
  PART_NAMES[line.part],
  line.name,
  ...place(trace, line.frequency, 5),
  amplitudeText(amplitudeAt(trace, line.frequency), trace),
]);

/** A spectrum for exportButtons(), over the axis that is shown. */
export function spectrumFile(plot) {
  const { trace, options, view } = plot;
  if (!trace || !plot.plot) return null;
  const unit = view.scale === "db" ? trace.decibel : unitText(trace);
  const columns = [
    [plot.xLabel(), plot.x],
    [`block ${trace.block}, ${unit}`, plot.up(trace.amplitude)],
    ...(plot.overlay ? [[`block ${plot.other.block}, ${unit}`, plot.up(plot.overlay)]] : []),
  ];
  const marks = view.cursor === "lines"
    ? plot.shownLines().filter((line) => line.main).map((line) => ({ x: plot.across(line.frequency), label: line.label, ink: colour(line.part) }))
    : plot.cursorLines().map(({ frequency, label }) => ({ x: plot.across(frequency), label, ink: colour("path") }));
  return {
    name: `${options.name}-${trace.block}`,
    title: `${options.title(trace)}; ${options.describe(trace)}`,
    x: plot.xLabel(), y: plot.yLabel(), columns, marks, log: view.scale === "log",
    range: plot.range().map((value) => plot.across(value)), canvas: plot.plot.ctx.canvas,
  };
}
