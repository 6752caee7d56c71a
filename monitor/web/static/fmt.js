// Every number, time and duration that people read is formatted here.

export const MISSING = "–";
const THIN = "\u202f";
const SPACE = "\u00a0";
const RANGE = "\u202f–\u2009";

export const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

/** A number to so many significant figures, without an exponent where it can be read without one. */
export function number(value, figures = 3) {
  if (!isNumber(value)) return MISSING;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 1e7) return value.toExponential(figures - 1).replace("e+", "e").replace("-", "−");
  const decimals = Math.max(0, figures - 1 - Math.floor(Math.log10(size)));
  return value.toLocaleString("en", { maximumFractionDigits: decimals, useGrouping: size >= 10000 }).replace("-", "−");
}

export const count = (value) => (isNumber(value) ? value.toLocaleString("en") : MISSING);
export const counted = (value, noun) => `${count(value)} ${noun}${value === 1 ? "" : "s"}`;
export const withUnit = (value, unit) => (isNumber(value) ? `${number(value)}${THIN}${unit}` : MISSING);
export const volume = (value) => withUnit(value, "mm³/mm");

/** V_eq and its interval in mm³/mm, or as multiples of its first value where the rig is not calibrated. */
export function sizeOf(status, calibrated) {
  const { v_eq_mm2: found, v_eq_lower_mm2: lower, v_eq_upper_mm2: upper, v_eq_relative: times } = status;
  if (calibrated || !isNumber(times) || !(found > 0)) return { absolute: true, value: found, lower, upper };
  const scaled = (value) => (isNumber(value) ? (value * times) / found : value);
  return { absolute: false, value: times, lower: scaled(lower), upper: scaled(upper) };
}

export const hertz = (value, figures = 4) => (isNumber(value) ? `${number(value, figures)}${THIN}Hz` : MISSING);

/** Least and highest speed, null where they are one. */
export function speeds(range) {
  if (!isNumber(range?.[0])) return null;
  const [low, high] = range.map((value) => number(value, 3));
  return low === high ? null : `speed from ${low} to ${high}${THIN}Hz`;
}

/** The unit in which levels of a channel are shown. */
export const levelUnit = (unit) => (unit === "g" ? "g" : "of unknown unit");
export const level = (value, unit) => (isNumber(value) ? `${number(value)}${unit === "g" ? `${THIN}g` : ""}` : MISSING);

/** An interval in one unit. */
export function interval(lower, upper, show = number) {
  if (!isNumber(lower) && !isNumber(upper)) return "";
  if (!isNumber(upper)) return `from ${show(lower)}`;
  return `${isNumber(lower) ? show(lower) : "?"}${RANGE}${show(upper)}`;
}

/** A probability, which is never said to be certain. */
export function probability(value) {
  if (!isNumber(value)) return MISSING;
  if (value > 0.99) return `over 99${THIN}%`;
  if (value < 0.01) return `under 1${THIN}%`;
  return `${Math.round(value * 100)}${THIN}%`;
}

export const percent = (value) => (isNumber(value) ? `${Math.round(value * 100)}${THIN}%` : MISSING);

/** A duration to about two figures: "45 s", "12 min", "2 h 10 min", "3 d 4 h". */
export function duration(seconds) {
  if (!isNumber(seconds)) return MISSING;
  if (seconds < 0) return `−${duration(-seconds)}`;
  if (seconds < 90) return `${number(seconds, 2)}${THIN}s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return `${minutes}${THIN}min`;
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return minutes % 60 && hours < 12 ? `${hours}${THIN}h${SPACE}${minutes % 60}${THIN}min` : `${Math.round(minutes / 60)}${THIN}h`;
  const all = Math.round(seconds / 3600);
  const days = Math.floor(all / 24);
  if (days >= 730) return `${number(days / 365.25, 3)}${THIN}years`;
  return all % 24 && days < 14 ? `${days}${THIN}d${SPACE}${all % 24}${THIN}h` : `${Math.round(all / 24)}${THIN}d`;
}

/** How long ago, in steps that do not flicker. */
export function age(seconds) {
  if (!isNumber(seconds)) return MISSING;
  if (seconds < 10) return "now";
  return `${duration(seconds < 90 ? Math.floor(seconds / 10) * 10 : seconds)} ago`;
}

/** Unit and divisor in which durations up to `most` seconds are drawn. */
export function durationUnit(most) {
  if (most < 180) return ["s", 1];
  if (most < 3 * 3600) return ["min", 60];
  if (most < 4 * 86400) return ["h", 3600];
  return ["d", 86400];
}

const formats = new Map();

function parts(time, zone) {
  let format = formats.get(zone);
  if (!format) {
    format = new Intl.DateTimeFormat("en-GB", {
      timeZone: zone, year: "numeric", month: "2-digit", day: "2-digit",
      hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23", timeZoneName: "short",
    });
    formats.set(zone, format);
  }
  return Object.fromEntries(format.formatToParts(new Date(time * 1000)).map((part) => [part.type, part.value]));
}

/** The zone that the browser knows by this name, else UTC. */
export function knownZone(zone) {
  try {
    new Intl.DateTimeFormat("en", { timeZone: zone });
    return zone || "UTC";
  } catch {
    return "UTC";
  }
}

/** A moment: a date and time in a zone, how long after the first block, or (`dated` null) that no time is known. */
export function moment(time, { dated = true, zone = "UTC", seconds = true } = {}) {
  if (!isNumber(time)) return MISSING;
  if (dated === null) return "at an unknown time";
  if (!dated) return `${duration(time)} after the first block`;
  const p = parts(time, zone);
  const clock = `${p.hour}:${p.minute}${seconds ? `:${p.second}` : ""}`;
  return `${p.year}-${p.month}-${p.day} ${clock} ${zone === "UTC" ? "UTC" : p.timeZoneName}`;
}

const MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

/** A label on a time axis whose labels are `step` seconds apart: the date where a day begins, else the time of day. */
export function tick(time, step, zone) {
  const p = parts(time, zone);
  const day = `${Number(p.day)} ${MONTHS[Number(p.month) - 1]}`;
  if (step >= 28 * 86400) return `${MONTHS[Number(p.month) - 1]} ${p.year}`;
  if (step >= 86400 || (p.hour === "00" && p.minute === "00" && p.second === "00")) return day;
  return step < 60 ? `${p.hour}:${p.minute}:${p.second}` : `${p.hour}:${p.minute}`;
}

/** Day and time of day, where there is little room. */
export function short(time, zone) {
  const p = parts(time, zone);
  return `${Number(p.day)} ${MONTHS[Number(p.month) - 1]} ${p.hour}:${p.minute}`;
}

/** A time of day alone. */
export function clock(time, zone = "UTC") {
  const p = parts(time, zone);
  return `${p.hour}:${p.minute}:${p.second} ${zone === "UTC" ? "UTC" : p.timeZoneName}`;
}

export function bytes(value) {
  if (!isNumber(value)) return MISSING;
  if (value < 1e6) return `${number(value / 1e3, 2)}${THIN}kB`;
  return value < 1e9 ? `${number(value / 1e6)}${THIN}MB` : `${number(value / 1e9)}${THIN}GB`;
}

/** Seconds since 1970 of an ISO time, or null. */
export function fromIso(text) {
  const value = typeof text === "string" ? Date.parse(text) / 1000 : NaN;
  return isNumber(value) ? value : null;
}
