// Columns of records over time: few or many, as the server decided, and longer by what comes live.

import { isNumber } from "./fmt.js";

const GAP = 6;

/** The usual distance between points, s. */
function usualStep(time) {
  if (time.length < 2) return Infinity;
  const steps = [];
  const stride = Math.max(1, Math.floor(time.length / 200));
  for (let i = stride; i < time.length; i += stride) steps.push((time[i] - time[i - stride]) / stride);
  steps.sort((a, b) => a - b);
  return steps[Math.floor(steps.length / 2)] || Infinity;
}

export class TrendData {
  /** Take an answer of the server. */
  constructor(answer) {
    this.dated = answer.dated;
    this.resolution = answer.resolution_s;
    this.first = answer.first_s;
    this.last = answer.last_s;
    this.updating = answer.updating ?? false;
    this.columns = answer.columns;
    this.time = answer.columns.time_s ?? [];
    this.measure();
  }

  get size() {
    return this.time.length;
  }

  measure() {
    this.step = Math.max(usualStep(this.time), this.resolution ?? 0);
  }

  /** Smallest and largest values of a column, or null where there is none at all. */
  column(name) {
    const low = this.columns[`${name}_min`] ?? this.columns[name];
    const high = this.columns[`${name}_max`] ?? this.columns[name];
    return low && high && high.some(isNumber) ? { low, high } : null;
  }

  /** Add what came live; returns how many points are new. */
  append(answer) {
    const { columns } = answer;
    const last = this.time.length ? this.time.at(-1) : -Infinity;
    const from = (columns.time_s ?? []).findIndex((time) => time > last);
    if (from < 0) return 0;
    const fresh = columns.time_s.length - from;
    const size = this.time.length;
    this.columns.time_s = this.time;
    for (const name of new Set([...Object.keys(this.columns), ...Object.keys(columns)])) {
      const old = (this.columns[name] ??= new Array(size).fill(null));
      const more = columns[name];
      for (let i = 0; i < fresh; i += 1) old.push(more ? more[from + i] ?? null : null);
    }
    this.last = this.time.at(-1);
    this.first ??= this.time[0];
    if (size < 4) this.measure();
    return fresh;
  }

  /** Times with a break wherever data are missing, and for each of them the place in the columns or -1. */
  broken() {
    const time = [];
    const places = [];
    for (let i = 0; i < this.time.length; i += 1) {
      if (i && this.time[i] - this.time[i - 1] > GAP * this.step) {
        time.push((this.time[i] + this.time[i - 1]) / 2);
        places.push(-1);
      }
      time.push(this.time[i]);
      places.push(i);
    }
    return { time, places };
  }

  /** Least and greatest value of some columns; (infinite, 0) without any. */
  span(names) {
    let least = Infinity;
    let most = 0;
    for (const name of names) {
      const { low, high } = this.column(name) ?? { low: [], high: [] };
      for (const value of low) if (isNumber(value) && value < least) least = value;
      for (const value of high) if (value > most) most = value;
    }
    return [least, most];
  }

  /** Whether positive values span more than a factor of five, as in the report: their axis is logarithmic. */
  isWide(names) {
    const [least, most] = this.span(names);
    return least > 0 && most > 5 * least;
  }

  /** The one value of columns, or null where they are empty or span more than a share. */
  constant(names, share = 0.005) {
    const values = names.map((name) => this.column(name)).flatMap((found) => (found ? [...found.low, ...found.high] : [])).filter(isNumber);
    if (!values.length) return null;
    const low = values.reduce((a, b) => Math.min(a, b));
    const high = values.reduce((a, b) => Math.max(a, b));
    return high - low <= share * Math.abs(high) ? high : null;
  }
}

/** Values at the places of a broken time axis, times a factor. */
export const placed = (values, places, factor = 1) =>
  places.map((place) => (place < 0 || !isNumber(values[place]) ? null : values[place] * factor));
