// What spectra say, without a picture: lines of the parts, amplitudes at them, peaks, other units and axes.

import * as fmt from "./fmt.js";
import { LINE_NAMES } from "./words.js";

export const ORDERS = 5;
const NEAR = 0.012;
const GRAVITY = 9.80665;
const MAX_VELOCITY_HZ = 1000;
const RMS = Math.SQRT1_2;

/** Lines of a part in a spectrum: harmonics, and side lines where they are told apart. */
export function faultLines(spectrum, part, sidebands, orders = ORDERS) {
  const found = [];
  const first = spectrum.lines_hz?.[part];
  if (!fmt.isNumber(first)) return found;
  const side = part === "inner" ? spectrum.speed_hz : part === "ball" ? spectrum.lines_hz.cage : null;
  const sideName = part === "inner" ? "shaft" : "cage";
  for (let n = 1; n <= orders; n += 1) {
    const name = `${n} × ${LINE_NAMES[part]}`;
    found.push({
      frequency: n * first,
      label: n === 1 ? LINE_NAMES[part] : `${n}×`,
      name: [name, ...sharedWith(spectrum, part, n)].join(" = "),
      shared: sharedWith(spectrum, part, n),
      main: true,
      part,
      harmonic: n,
    });
    if (!sidebands || n > ORDERS || !fmt.isNumber(side)) continue;
    for (const k of [-2, -1, 1, 2]) found.push({
      frequency: n * first + k * side,
      label: "",
      name: `${name} ${k > 0 ? "+" : "−"} ${Math.abs(k)} × ${sideName}`,
      shared: [],
      main: false,
      part,
      harmonic: n,
    });
  }
  return found.filter((line) => line.frequency > 0);
}

/** Lines of the shaft. */
export function shaftLines(spectrum) {
  if (!fmt.isNumber(spectrum.speed_hz)) return [];
  return Array.from({ length: ORDERS }, (_, k) => ({
    frequency: (k + 1) * spectrum.speed_hz,
    label: k === 0 ? "shaft" : "",
    name: `${k + 1} × shaft`,
    shared: [],
    main: k === 0,
    part: "shaft",
    harmonic: k + 1,
  }));
}

/** Names of the lines of other parts that stand on the same peak. */
function sharedWith(spectrum, part, order) {
  const group = (spectrum.shared_lines ?? []).find((lines) => lines.some(([family, n]) => family === part && n === order));
  return (group ?? []).filter(([family]) => family !== part).map(([family, n]) => `${n} × ${LINE_NAMES[family]}`);
}

/** Lines of several parts that stand on one peak, "" for none. */
export const sharedWords = (spectrum) =>
  (spectrum?.shared_lines ?? []).map((lines) => lines.map(([family, n]) => `${n} × ${LINE_NAMES[family]}`).join(" = ")).join("; ");

/** Index of the first frequency that is not below a value. */
export function placeOf(frequency, value) {
  let low = 0;
  let high = frequency.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (frequency[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Largest amplitude within two bins of a frequency, or null beyond the spectrum. */
export function amplitudeAt(trace, frequency) {
  const last = trace.frequency.at(-1);
  if (!(frequency >= 0 && frequency <= last)) return null;
  const place = placeOf(trace.frequency, frequency - trace.resolution / 2);
  const near = trace.amplitude.slice(Math.max(0, place - 2), place + 3).filter(fmt.isNumber);
  return near.length ? Math.max(...near) : null;
}

/** The highest local maxima between two frequencies, highest first: {frequency, amplitude}. */
export function peaks(trace, from, to, many = 10) {
  const { frequency, amplitude } = trace;
  const found = [];
  for (let i = Math.max(2, placeOf(frequency, from)); i < amplitude.length - 2 && frequency[i] <= to; i += 1) {
    const value = amplitude[i];
    if (!(value > 0)) continue;
    if (value >= amplitude[i - 1] && value > amplitude[i + 1] && value >= amplitude[i - 2] && value > amplitude[i + 2])
      found.push({ frequency: frequency[i], amplitude: value });
  }
  return found.sort((a, b) => b.amplitude - a.amplitude).slice(0, many);
}

/** The line of the list that is nearest to a frequency and near enough, harmonics before side lines; or null. */
export function lineNear(lines, frequency, resolution) {
  const near = lines.filter((line) => Math.abs(line.frequency - frequency) <= Math.max(NEAR * line.frequency / line.harmonic, 1.5 * resolution));
  near.sort((a, b) => b.main - a.main || Math.abs(a.frequency - frequency) - Math.abs(b.frequency - frequency));
  return near[0] ?? null;
}

/** The velocity spectrum of an acceleration spectrum: mm/s, RMS, from 2 to 1000 Hz. */
export function toVelocity(trace) {
  const frequency = trace.frequency.slice(0, placeOf(trace.frequency, MAX_VELOCITY_HZ + trace.resolution / 2));
  const amplitude = frequency.map((f, i) =>
    f < 2 || !fmt.isNumber(trace.amplitude[i]) ? null : (1e3 * GRAVITY * RMS * trace.amplitude[i]) / (2 * Math.PI * f),
  );
  return { ...trace, frequency, amplitude, ...QUANTITIES.velocity };
}

/** What is drawn: name and unit of the axis, and what one of the unit is in that of the decibel (RMS). */
export const QUANTITIES = {
  envelope: { quantity: "envelope of the acceleration", unit: "g", si: RMS * GRAVITY * 1e6, decibel: "dB re 1 µm/s², RMS" },
  acceleration: { quantity: "acceleration, peak of a line", unit: "g", si: RMS * GRAVITY * 1e6, decibel: "dB re 1 µm/s², RMS" },
  cyclic: { quantity: "squared coherence", unit: null, si: 1, decibel: "dB re 1" },
  ias: { quantity: "angular speed, peak", unit: "rad/s", si: RMS * 1e6, decibel: "dB re 1 µrad/s, RMS", scale: "log" },
  velocity: { quantity: "velocity, RMS of a line", unit: "mm/s", si: 1e6, decibel: "dB re 1 nm/s, RMS" },
};

/** The quantity in the sensor's own unit. */
export function quantityOf(kind, unit) {
  const known = QUANTITIES[kind];
  return unit === "g" ? known : { ...known, unit: "", si: RMS, decibel: "dB re 1 unit of the sensor, RMS" };
}

/** The unit of an axis or a column. */
export const unitText = ({ unit, quantity }) => (unit === null ? quantity : unit || "unit of the sensor");

export const decibel = (value, trace) => (value > 0 ? 20 * Math.log10(value * trace.si) : null);
export const amplitudeText = (value, trace) => (fmt.isNumber(value) ? (trace.unit ? fmt.withUnit(value, trace.unit) : fmt.number(value)) : fmt.MISSING);

/** The amplitudes of another spectrum at the frequencies of this one: the highest that falls to each. */
export function onGrid(other, trace, factor = 1) {
  const found = new Array(trace.frequency.length).fill(null);
  const { frequency } = trace;
  const reach = Math.max(trace.resolution, other.resolution * factor) * 0.75;
  other.frequency.forEach((f, i) => {
    const value = other.amplitude[i];
    if (!fmt.isNumber(value)) return;
    const at = f * factor;
    let place = placeOf(frequency, at);
    if (place > 0 && (place === frequency.length || at - frequency[place - 1] < frequency[place] - at)) place -= 1;
    const wide = Math.max(reach, place + 1 < frequency.length ? 0.75 * (frequency[place + 1] - frequency[place]) : 0);
    if (Math.abs(frequency[place] - at) <= wide && !(found[place] >= value)) found[place] = value;
  });
  return found;
}

/** Number of a block that shows the healthy bearing: in the middle of those before the final stage, or null. */
export function baselineBlock(blocks, state) {
  const before = blocks.filter((block) => !state?.t_fs_block || block < state.t_fs_block);
  return before.length ? before[Math.floor(before.length / 2)] : null;
}

const MAX_HARMONICS = 60;
const SIDES = 10;

/** Lines of the harmonic or the sideband cursor {at, spacing}, by default the shaft's: {frequency, label}. */
export function cursorLines(kind, { at, spacing }, trace) {
  const last = trace.frequency.at(-1);
  if (!(at > 0)) return [];
  if (kind === "harmonics") return Array.from(
    { length: Math.min(MAX_HARMONICS, Math.floor(last / at)) },
    (_, k) => ({ frequency: (k + 1) * at, label: k === 0 ? "f" : `${k + 1}` }),
  );
  const side = spacing > 0 ? spacing : trace.speed_hz;
  if (!(side > 0)) return [{ frequency: at, label: "f" }];
  return Array.from({ length: 2 * SIDES + 1 }, (_, k) => k - SIDES)
    .map((k) => ({ frequency: at + k * side, label: k === 0 ? "f" : `${k > 0 ? "+" : "−"}${Math.abs(k)}` }))
    .filter(({ frequency }) => frequency > 0 && frequency <= last);
}

/** Times of marks `per` turns of the shaft apart through the time `from`, in the first `end` s of a block. */
export function turnMarks(block, per, from, end) {
  const course = block.speed_course_hz ?? [block.speed_hz, block.speed_hz];
  const step = block.samples / block.rate_hz / (course.length - 1);
  const turns = [0];
  for (let k = 1; k < course.length; k += 1) turns.push(turns[k - 1] + (step * (course[k - 1] + course[k])) / 2);
  const place = Math.min(Math.floor(from / step), course.length - 2);
  const begin = turns[place] + (from / step - place) * (turns[place + 1] - turns[place]);
  const marks = [];
  for (let turn = begin % per, k = 0; k < course.length - 1; turn += per) {
    while (k < course.length - 1 && turns[k + 1] < turn) k += 1;
    const at = (k + (turn - turns[k]) / (turns[k + 1] - turns[k])) * step;
    if (!(at <= end)) break;
    marks.push(at);
  }
  return marks;
}
