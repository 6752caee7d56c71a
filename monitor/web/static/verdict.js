// What an engineer asks first: how does it stand, since when, where, how large, how long is left, and how sure is that.

import { disagreement, support } from "./bearings.js";
import { h, symbol } from "./dom.js";
import * as fmt from "./fmt.js";
import {
  RELATIVE, STATES, alarmLevel, baseSentence, baseWord, bearingFault, domainWord, edvSentence, faultWords, featureWord, gearKind, gearSentence,
  levelSentence, rotationSentence, stageWord, ttSentence, ttaSentence, velocitySentence, zoneSentence,
} from "./words.js";

const answer = (question, value, ...more) =>
  h(
    "div",
    { class: "answer" },
    h("dt", null, question),
    h("dd", null, h("span", { class: "value" }, value), more.filter(Boolean).map((text) => h("span", { class: "note" }, text))),
  );

/** The answers as a list of terms. */
export function verdict({ row, info, zone, age, machine }) {
  const status = row?.status ?? info?.state ?? {};
  return h("dl", { class: "answers" }, [
    inWords(row, status),
    together(machine, info),
    standing(row, status, info),
    since(status, info, zone, row),
    part({ ...status, fault: bearingFault(status) }),
    gears(status),
    size(status, info),
    left(status, info),
    alarmTime(status, info),
    machineVibration(status, info),
    latest(status, info, zone, age, machine),
  ]);
}

/** What is wrong, how sure that is, and what to do next; null where a daemon of an older version does not say it. */
function inWords(row, status) {
  if (!status.headline) return null;
  const before = row?.stale && row.state !== "no_data" ? "when it was last heard: " : "";
  const element = answer("In words", `${before}${status.headline}`, status.sureness, status.level);
  element.lastChild.append(h("span", { class: "todo" }, h("b", null, "What to do: "), status.action));
  element.classList.add("whole", "words");
  return element;
}

function standing(row, status, info) {
  const state = row?.state ?? "no_data";
  const alarmed = status.alarms ?? [];
  // Where the danger of a rule stands, its alert goes without saying.
  const worst = alarmed.filter(
    (alarm) => alarm.severity === "danger" || !alarmed.some((other) => other.rule === alarm.rule && other.severity === "danger"),
  );
  const alarms = worst.map((alarm) => alarmText(alarm, info));
  const element = answer(
    "How does it stand?",
    [symbol(state), " ", STATES[state][0]],
    alarms.length && !row?.stale && state !== "no_data" && state !== "bad_data" ? null : row?.reason ?? STATES[state][1],
    ...alarms,
  );
  element.dataset.state = state;
  return element;
}

function alarmText(alarm, info) {
  const level = (info?.levels ?? []).find((one) => one.rule === alarm.rule && one.feature === alarm.feature);
  const value = level?.[alarm.severity];
  const bound = fmt.isNumber(value) ? ` ${level.side === "below" ? "below" : "above"} ${boundText(value, level.column, info)}` : "";
  const since = alarm.since_block ? ` since block ${alarm.since_block}` : "";
  const over = alarm.active === false ? ", over by now, waits to be acknowledged" : "";
  return `${alarm.severity}: ${featureWord(alarm.feature)}${bound}${since}${over}`;
}

function boundText(value, column, info) {
  if (column?.endsWith("_g")) return fmt.level(value, info.unit);
  if (column?.endsWith("_mm_s")) return fmt.withUnit(value, "mm/s");
  if (column?.endsWith("_s")) return fmt.duration(value);
  if (column?.endsWith("_mm2")) return fmt.volume(value);
  return fmt.number(value);
}

function since(status, info, zone, row) {
  const marks = info?.marks ?? {};
  const options = { dated: info?.dated, zone, seconds: false };
  const block = (number) => (fmt.isNumber(number) ? `block ${number}` : null);
  if (status.stage === "end_of_life")
    return answer(
      "Since when?",
      `end of life ${fmt.isNumber(marks.t_eol_s) ? fmt.moment(marks.t_eol_s, options) : block(status.t_eol_block) ?? ""}`,
      fmt.isNumber(marks.t_fs_s) ? `final stage since ${fmt.moment(marks.t_fs_s, options)}` : null,
    );
  if (status.t_fs_block || status.stage === "final") {
    const began = fmt.isNumber(marks.t_fs_s) ? (info.dated ? fmt.short(marks.t_fs_s, zone) : fmt.moment(marks.t_fs_s, options)) : block(
      status.t_fs_block,
    );
    const known = fmt.isNumber(marks.t_fs_known_s) ? fmt.moment(marks.t_fs_known_s, options) : block(status.t_fs_known_block);
    return answer("Since when?", began ?? "an unknown time", "the final stage began then", known && `known ${known}`);
  }
  if (status.stage === "learning") return answer(
    "Since when?",
    "learning",
    "what healthy means for this channel is being learned; nothing is judged before",
  );
  if (status.stage === "healthy" && (row?.stale || row?.state === "no_data" || row?.state === "bad_data"))
    return answer("Since when?", "not known", "there was no sign of a final stage before; nothing is known since");
  const closed = status.closed_episodes?.at(-1);
  if (status.stage === "healthy" && closed) return answer(
    "Since when?",
    "no final stage",
    `the one of block ${closed.t_fs_block} closed again with block ${closed.closed_block}: back at the baseline`,
  );
  if (status.stage === "healthy") return answer("Since when?", "no final stage", "nothing departs from what was learned as healthy");
  return answer("Since when?", stageWord(status.stage) || fmt.MISSING, "no block has been judged yet");
}

function part(status) {
  if (!status.fault) return answer("Which part?", "none named", "no family of lines stands out of the envelope spectrum");
  const parts = status.fault_candidates?.join("|");
  if (parts) return answer(
    "Which part?",
    faultWords(parts),
    "the signal does not show the shaft, and the stated speed does not decide between them",
  );
  const both = status.fault.includes("|") ? "their lines cannot be told apart here" : null;
  const stated = status.speed_unverified ? "the shaft speed is as stated; the signal does not show it" : null;
  return answer(
    "Which part?",
    faultWords(status.fault),
    fmt.isNumber(status.fault_snr) ? `lines ${fmt.number(status.fault_snr, 2)} times the floor under them` : null,
    both,
    stated,
    status.fault_basis === "hint" ? `a hint: ${baseSentence("hint")}` : null,
  );
}

/** What is said of the wheels of gears, or null where there are none. */
function gears(status) {
  const wheels = Object.entries(status.gears ?? {});
  if (!wheels.length) return null;
  const figures = (found) => ["fm0", "fm4", "na4", "m6a"]
    .filter((name) => fmt.isNumber(found[name])).map((name) => `${name.toUpperCase()} ${fmt.number(found[name], 3)}`).join(", ");
  const notes = wheels.map(([name, found]) => `${name.split("|").join(" or ")}: ${found.status === "ok" ? figures(found) : gearSentence(found.status)}`);
  const kind = status.gear_fault ? `${gearKind(status.gear_kind)} (hint); named since block ${status.gear_since_block}` : null;
  return answer("Which gear?", status.gear_fault ? faultWords(status.gear_fault) : "none named", kind, ...notes);
}

/** What all channels of its bearing say together, or null where the daemon does not say it. */
function together(machine, info) {
  const name = info?.bearing?.name;
  const found = machine?.bearings?.[name];
  if (!found) return null;
  const notes = found.fault
    ? [`${baseWord(found.fault_basis)}: ${baseSentence(found.fault_basis)}`, `${support(found)} of ${channelsWords(found)}`, disagreement(found)]
    : [levelSentence(found.level_of) || null, channelsWords(found)];
  const element = answer(`Bearing ${name}`, faultWords(found.fault) || "no part named", ...notes);
  element.classList.add("whole");
  return element;
}

const channelsWords = (found) => fmt.counted((found.channels ?? []).length, "channel");

function size(status, info) {
  const calibrated = (status.calibrated ?? info?.calibrated) !== false;
  if (!fmt.isNumber(status.v_eq_mm2)) {
    if (info && !info.tracked) return answer("How large?", "not tracked", "the size of damage is not asked for on this channel");
    return answer("How large?", "cannot be said", edvSentence(status.edv_status));
  }
  const found = fmt.sizeOf(status, calibrated);
  const range = fmt.interval(found.lower, found.upper);
  const share = fmt.isNumber(info?.interval) ? fmt.percent(info.interval) : "";
  const doubt = ["ok", "uncalibrated", null, undefined].includes(status.edv_status) ? null : edvSentence(status.edv_status);
  return answer(
    "How large?",
    found.absolute ? fmt.volume(found.value) : `${fmt.number(found.value)} ${RELATIVE}`,
    range ? `${share} interval ${range}` : "a single number: this method gives no interval",
    doubt,
    calibrated ? null : edvSentence("uncalibrated"),
  );
}

function left(status, info) {
  const threshold = info?.thresholds_mm2?.[0];
  const end = info?.forecast_end === "recorded runs" ? "until the end, as recorded runs ended" : null;
  const to = fmt.isNumber(threshold) ? `until ${fmt.volume(threshold)}` : end;
  const probable = fmt.isNumber(
    status.p_threshold,
  ) ? `reached within the maintenance window: ${fmt.probability(status.p_threshold)}` : null;
  if (status.tt_status === "already_crossed") return answer(
    "How long is left?",
    "threshold reached",
    to && to.replace("until", "V_eq is beyond"),
    probable,
  );
  if (!fmt.isNumber(status.tt_s)) {
    if (info && !info.tracked) return answer("How long is left?", "not forecast", "a forecast needs the size of the damage");
    const still = status.tt_status === "no_growth" && fmt.isNumber(status.p_no_growth)
      ? `probability: ${fmt.probability(status.p_no_growth)}` : null;
    return answer("How long is left?", "cannot be said", ttSentence(status.tt_status), still, probable);
  }
  const range = fmt.interval(status.tt_lower_s, status.tt_upper_s, fmt.duration);
  const share = fmt.isNumber(info?.interval) ? fmt.percent(info.interval) : "";
  return answer(
    "How long is left?",
    fmt.duration(status.tt_s),
    range ? `${share} interval ${range}` : "a single number: this method gives no interval",
    to,
    probable,
  );
}

/** Time to the alarm level by the trend of RMS, or null where no final stage makes it a question. */
function alarmTime(status, info) {
  if ([undefined, null, "learning", "not_final_stage"].includes(status.tta_status)) return null;
  const question = "How long to the alarm level?";
  const factor = fmt.isNumber(status.tta_level_factor) ? `${fmt.number(status.tta_level_factor, 3)} times the baseline` : null;
  const source = status.tta_level_source;
  const to = source ? [alarmLevel(source), source === "default" ? null : factor].filter(Boolean).join(", ") : null;
  if (status.tta_status === "reached") return answer(question, "reached", to);
  if (!fmt.isNumber(status.tta_s)) return answer(question, "cannot be said", ttaSentence(status.tta_status), to);
  const range = fmt.isNumber(status.tta_upper_s)
    ? fmt.interval(status.tta_lower_s, status.tta_upper_s, fmt.duration)
    : `from ${fmt.duration(status.tta_lower_s)}`;
  const share = fmt.isNumber(info?.interval) ? fmt.percent(info.interval) : "";
  return answer(question, fmt.duration(status.tta_s), `${share} interval ${range}`, to && `RMS reaches ${to}, by its trend`);
}

/** Velocity and its zone, or why there is none; null where nothing was computed. */
function machineVibration(status, info) {
  if (!status.velocity_status) return null;
  const question = "Vibration of the machine";
  const judged = info?.iso_class;
  if (!fmt.isNumber(status.velocity_rms_mm_s)) return judged
    ? answer(question, "no velocity", velocitySentence(status.velocity_status)) : null;
  const zone = status.velocity_zone;
  const floor = status.velocity_floor_mm_s;
  return answer(
    question,
    fmt.withUnit(status.velocity_rms_mm_s, "mm/s"),
    zone ? `zone ${zone}: ${zoneSentence(zone)}` : judged ? "no zone: at this speed or with this block none is given" : null,
    zone ? `${judged?.text ?? ""}; it says nothing of the bearings` : "RMS from 10 to 1000 Hz",
    floor > 0.5 * status.velocity_rms_mm_s ? `${fmt.withUnit(floor, "mm/s")} of it are continuous, as noise of the sensor is` : null,
  );
}

function latest(status, info, zone, age, machine) {
  const time = fmt.fromIso(status.last_block_utc);
  const value = fmt.isNumber(age) ? fmt.age(age) : time === null ? fmt.MISSING : fmt.moment(time, { zone, seconds: false });
  const verdict = [undefined, null, "ok"].includes(status.last_block_status) ? "" : `, ${status.last_block_status.replaceAll("_", " ")}`;
  const which = status.last_block ? `block ${status.last_block}${verdict}` : "no block yet";
  const bearing = info?.bearing ? [
    info.bearing.designation ?? info.bearing.name,
    fmt.isNumber(info.bearing.n_elements) ? fmt.counted(info.bearing.n_elements, "element") : null,
  ].filter(Boolean).join(", ") : null;
  const pending = machine?.sources?.[status.source]?.pending;
  const limit = info?.velocity_limit_hz;
  const sensor = fmt.isNumber(limit) ? `sensor of velocity: acceleration up to ${fmt.hertz(limit)} by differentiation` : null;
  return answer("Last block", value, which, condition(info), rotation(status), sensor, bearing, pending > 1 ? `${fmt.counted(pending, "block")} waiting` : null);
}

/** What the shaft did in the block, or why its angle is not known; null without a source of it. */
function rotation({ rotation_status: found, domain, speed_min_hz: least, speed_max_hz: highest }) {
  if (!found) return null;
  if (found !== "ok") return `no angle of the shaft: ${rotationSentence(found)}; ${domainWord("hertz")}`;
  const range = fmt.speeds([least, highest]);
  return `${range ? `${range} in this block; ` : ""}${domainWord(domain)}`;
}

function condition(info) {
  const speed = info?.speed_hz;
  const load = info?.load_newton;
  const parts = [
    fmt.isNumber(speed) && `${fmt.hertz(speed)} (${fmt.number(speed * 60, 4)} rpm)`,
    fmt.isNumber(load) && fmt.withUnit(load, "N"),
  ].filter(Boolean);
  return parts.length ? parts.join(", ") : null;
}
