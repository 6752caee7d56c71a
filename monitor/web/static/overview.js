// All channels of all machines, grouped by state, worst first. Rows are kept and changed in place.

import { channelHref } from "./api.js";
import { Bearings } from "./bearings.js";
import { arrange, fill, h, setAttribute, setSymbol, setText, symbol } from "./dom.js";
import * as fmt from "./fmt.js";
import { Sparks } from "./sparks.js";
import { STATES, STATE_ORDER, baseWord, edvSentence, faultWords, stageWord, ttSentence } from "./words.js";

const HEADS = ["", "Channel", "How it stands", "Stage, part", "RMS, zone", "V_eq, mm³/mm (interval)", "Time left (interval)", "Last block"];
const REFRESH = 5000;

class Row {
  constructor(row) {
    this.symbol = symbol(row.state);
    this.said = h("span", { class: "unseen" });
    this.reason = h("span", { class: "reason" });
    this.todo = h("span", { class: "todo" });
    this.why = h("span", { class: "why" }, this.reason, this.todo);
    this.stage = h("span", { class: "stage" });
    this.course = h("span", { class: "course" });
    this.zone = h("span", { class: "small" });
    this.level = h("span", { class: "level" }, this.course, this.zone);
    this.size = h("span", { class: "size" });
    this.left = h("span", { class: "left" });
    this.when = h("span", { class: "when" });
    const name = row.channel === null ? row.machine : [h("span", { class: "of" }, `${row.machine} / `), row.channel];
    const link = row.channel === null ? h("span", null, name) : h("a", { href: channelHref(row.machine, row.channel) }, name, this.said);
    this.element = h("li", { class: "row" }, this.symbol, link, this.why, this.stage, this.level, this.size, this.left, this.when);
    this.state = row.state;
  }

  update(row, age, zone) {
    const { status } = row;
    this.row = row;
    if (this.state !== row.state) {
      setAttribute(this.element, "data-changed", "");
      setTimeout(() => setAttribute(this.element, "data-changed", null), 2500);
    }
    this.state = row.state;
    setAttribute(this.element, "data-state", row.state);
    setAttribute(this.element, "data-stale", row.stale ? "" : null);
    setSymbol(this.symbol, row.state);
    setText(this.said, `, ${STATES[row.state][0]}`);
    setText(this.reason, row.reason);
    const known = !row.stale && row.state !== "normal" && row.state !== "check_function";
    setText(this.todo, known ? status.action ?? "" : "");
    const before = row.stale || row.state === "no_data" || row.state === "bad_data" ? "was " : "";
    const part = partWords(status);
    const stage = part && status.stage === "healthy" ? "healthy so far" : stageWord(status.stage);
    setText(this.stage, [stage ? before + stage : "", part].filter(Boolean).join("; "));
    setText(this.zone, status.velocity_zone ? ` ${fmt.number(status.velocity_rms_mm_s, 2)} mm/s, ${status.velocity_zone}` : "");
    const size = fmt.sizeOf(status, status.calibrated !== false);
    const shown = (value) => (size.absolute ? fmt.number(value) : `× ${fmt.number(value)}`);
    ranged(
      this.size,
      fmt.isNumber(size.value) ? shown(size.value) : "",
      fmt.interval(size.lower, size.upper, shown),
      refusal(status.edv_status, edvSentence),
    );
    const reached = status.tt_status === "already_crossed";
    ranged(
      this.left,
      reached ? "threshold reached" : fmt.isNumber(status.tt_s) ? fmt.duration(status.tt_s) : "",
      reached ? "" : fmt.interval(status.tt_lower_s, status.tt_upper_s, fmt.duration),
      refusal(status.tt_status, ttSentence),
    );
    this.setAge(age, zone);
    this.order = [-(status.alarms?.length ?? 0), status.tt_s ?? Infinity, row.machine, row.channel ?? ""];
    this.words = `${row.machine} ${row.channel ?? ""} ${STATES[row.state][0]} ${row.reason} ${this.stage.textContent}`.toLowerCase();
  }

  setAge(age, zone = "UTC") {
    const latest = fmt.fromIso(this.row.status.last_block_utc);
    setText(this.when, fmt.isNumber(age) ? fmt.age(age) : latest === null ? "" : fmt.short(latest, zone));
  }
}

/** The named part; before an onset it is a pattern that hints at it, never damage. */
const partWords = (status) => {
  const part = faultWords(status.fault_candidates?.join("|") ?? status.fault);
  return part && status.fault_basis === "hint" ? `a pattern of the ${part} (${baseWord("hint")})` : part;
};
const QUIETLY = new Set([undefined, null, "not_final_stage", "no_map", "no_library", "ok", "widened"]);
const refusal = (status, sentence) => (QUIETLY.has(status) ? "" : sentence(status));

function ranged(cell, value, range, refused) {
  const text = value ? `${value} ${range ? `(${range})` : ""}` : refused;
  if (cell.dataset.shown === text) return;
  cell.dataset.shown = text;
  if (!value) fill(cell, refused ? h("span", { class: "small", title: refused }, "refused: ", refused) : null);
  else fill(cell, h("span", { class: "whole" }, value), range ? h("span", { class: "range" }, ` (${range})`) : null);
}

function compare(a, b) {
  for (let i = 0; i < a.length; i += 1) {
    if (a[i] < b[i]) return -1;
    if (a[i] > b[i]) return 1;
  }
  return 0;
}

export class Overview {
  constructor(app) {
    this.app = app;
    this.rows = new Map();
    this.only = new Set();
    this.search = h(
      "input",
      { type: "search", placeholder: "Filter: machine, channel, part …", "aria-label": "Filter channels", oninput: () => this.filter() },
    );
    this.shown = h("span", { class: "note right", role: "status" });
    this.chips = h("div", { class: "chips", role: "group", "aria-label": "Filter by state" });
    this.groups = new Map(STATE_ORDER.map((state) => [state, this.makeGroup(state)]));
    this.body = h("div", null, this.heads(), [...this.groups.values()].map((group) => group.element));
    this.nothing = h("div", { class: "empty" });
    this.bearings = new Bearings(compare);
    this.sparks = new Sparks();
    this.element = h(
      "div",
      null,
      h("div", { class: "bar" }, h("h1", null, "Machines"), this.chips, this.search, this.shown),
      this.nothing,
      this.bearings.element,
      this.body,
    );
    this.timer = setInterval(() => this.tick(), REFRESH);
    this.update();
  }

  get title() {
    return "Machines";
  }

  heads() {
    return h("div", { class: "heads", "aria-hidden": "true" }, HEADS.map((head) => h("span", null, head)));
  }

  makeGroup(state) {
    const many = h("span", { class: "many" });
    const list = h("ul", { class: "rows" });
    const name = `group-${state}`;
    const chipMany = h("b");
    const chip = h(
      "button",
      { type: "button", class: "chip", "data-state": state, "aria-pressed": "false", onclick: () => this.toggle(state) },
      symbol(state),
      chipMany,
      STATES[state][0],
    );
    this.chips.append(chip);
    const element = h(
      "section",
      { class: "group", "data-state": state, "aria-labelledby": name },
      h("h2", { id: name }, symbol(state), STATES[state][0], many),
      list,
    );
    return { element, many, list, chip, chipMany };
  }

  /** Take over what the model knows now. */
  update() {
    const seen = new Set();
    const { model } = this.app;
    for (const row of model.rows()) {
      const key = JSON.stringify([row.machine, row.channel]);
      seen.add(key);
      let shown = this.rows.get(key);
      if (!shown) {
        this.rows.set(key, (shown = new Row(row)));
        this.sparks.watch(shown.element, shown.course, row.machine, row.channel);
      }
      shown.update(row, model.age(row), this.app.zone(row.machine));
    }
    for (const [key, shown] of this.rows) if (!seen.has(key)) {
      this.sparks.forget(shown.element);
      this.rows.delete(key);
    }
    this.bearings.update(model);
    this.sort();
    this.filter();
  }

  sort() {
    const byState = new Map(STATE_ORDER.map((state) => [state, []]));
    for (const row of this.rows.values()) byState.get(row.state).push(row);
    for (const [state, rows] of byState) {
      const group = this.groups.get(state);
      rows.sort((a, b) => compare(a.order, b.order));
      arrange(group.list, rows.map((row) => row.element));
      setText(group.chipMany, fmt.count(rows.length));
      group.chip.hidden = rows.length === 0;
      if (!rows.length) this.only.delete(state);
    }
  }

  toggle(state) {
    if (!this.only.delete(state)) this.only.add(state);
    this.filter();
  }

  filter() {
    const wanted = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    this.bearings.filter(wanted);
    const many = new Map(STATE_ORDER.map((state) => [state, 0]));
    for (const row of this.rows.values()) {
      const shown = wanted.every((word) => row.words.includes(word)) && (!this.only.size || this.only.has(row.state));
      if (row.element.hidden === shown) row.element.hidden = !shown;
      if (shown) many.set(row.state, many.get(row.state) + 1);
    }
    let all = 0;
    for (const [state, group] of this.groups) {
      all += many.get(state);
      group.element.hidden = many.get(state) === 0;
      setText(group.many, fmt.counted(many.get(state), "channel"));
      setAttribute(group.chip, "aria-pressed", this.only.has(state));
    }
    setText(
      this.shown,
      all === this.rows.size ? fmt.counted(all, "channel") : `${fmt.count(all)} of ${fmt.counted(this.rows.size, "channel")}`,
    );
    this.sayNothing(all);
  }

  sayNothing(shown) {
    this.nothing.hidden = shown > 0;
    this.body.hidden = shown === 0;
    if (shown) return;
    if (this.app.failure) fill(this.nothing, h("strong", null, "The machines could not be read"), this.app.failure.message);
    else if (!this.app.model.loaded) fill(this.nothing, "reading the machines …");
    else if (!this.rows.size) fill(
      this.nothing,
      h("strong", null, "No machine is configured here"),
      "A machine appears as soon as a daemon follows it: spallwatch run --config machine.toml",
    );
    else fill(
      this.nothing,
      h("strong", null, "No channel fits the filter"),
      h("button", { type: "button", onclick: () => this.clear() }, "Show all"),
    );
  }

  clear() {
    this.search.value = "";
    this.only.clear();
    this.filter();
  }

  /** Only ages change by themselves. */
  tick() {
    for (const row of this.rows.values()) row.setAge(this.app.model.age(row.row), this.app.zone(row.row.machine));
    if (this.app.model.rows().some((row) => row.stale !== this.rows.get(JSON.stringify([row.machine, row.channel]))?.row.stale)) this.update();
  }

  on(kind) {
    if (kind === "machines" || kind === "failure" || kind === "prefs") this.update();
  }

  close() {
    clearInterval(this.timer);
    this.sparks.close();
  }
}
