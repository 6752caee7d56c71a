// The event log: open events first, each with who acknowledged it and how.

import { channelHref, get, query } from "./api.js";
import { acknowledge, acknowledgeMany } from "./dialogs.js";
import { fill, h, symbol } from "./dom.js";
import * as fmt from "./fmt.js";
import { STATES } from "./words.js";

const PAGE = 100;
const BY_SEVERITY = { danger: "failure", alert: "maintenance_required" };
const BY_KIND = {
  end_of_life: "failure",
  final_stage: "maintenance_required",
  no_data: "no_data",
  alarm_cleared: "normal",
  alarm_released: "normal",
  alarm_withdrawn: "normal",
  baseline_relearned: "normal",
  final_stage_closed: "normal",
  data_again: "normal",
};

/** The state whose symbol an event bears. */
function stateOf(event) {
  const into = event.kind === "condition" ? event.details?.to : null;
  const found = into ?? BY_KIND[event.kind] ?? BY_SEVERITY[event.severity];
  return Object.hasOwn(STATES, found ?? "") ? found : event.open ? "maintenance_required" : "normal";
}

/** One event as a list item; `pick` has whether it is chosen, and is called with that when it changes. */
export function eventItem(app, event, onChange, pick = null) {
  const state = stateOf(event);
  const dated = event.dated ?? (event.time_s === null || event.time_s > 1e8);
  const place = [event.machine, event.channel].filter(Boolean).join(" / ");
  const link = event.channel ? h("a", { href: channelHref(event.machine, event.channel) }, place) : place;
  const when = fmt.moment(event.time_s, { dated, zone: app.zone(event.machine) });
  return h(
    "li",
    { class: pick ? "event picked" : "event", "data-state": state, "data-open": event.open, "data-id": event.id },
    pick && (event.open
      ? h("input", {
        type: "checkbox",
        "aria-label": `Choose: ${event.text}, ${place}`,
        checked: pick.chosen,
        onchange: (press) => pick.choose(press.target.checked),
      })
      : h("span")),
    symbol(state),
    h("span", { class: "text" }, event.text),
    h("span", { class: "meta" }, event.time_s === null ? "" : `${when} · `, link, event.block ? ` · block ${event.block}` : ""),
    event.acknowledgements.map((given) =>
      h(
        "span",
        { class: "given" },
        `acknowledged by ${given.who}, ${fmt.moment(given.time_s, { zone: app.zone(event.machine) })}`,
        given.note ? `: “${given.note}”` : "",
      ),
    ),
    event.open && h(
      "button",
      { type: "button", "aria-label": `Acknowledge: ${event.text}`, onclick: () => acknowledge(app, event, onChange) },
      "Acknowledge",
    ),
  );
}

export class Events {
  constructor(app, parameters = {}) {
    this.app = app;
    this.events = [];
    this.search = h(
      "input",
      { type: "search", placeholder: "Filter: channel, words …", "aria-label": "Filter events", oninput: () => this.draw() },
    );
    this.which = h(
      "select",
      { "aria-label": "Which events", onchange: () => this.draw() },
      h("option", { value: "all" }, "all, open ones first"),
      h("option", { value: "open" }, "open only"),
      h("option", { value: "time" }, "all, by time"),
    );
    this.standing = h(
      "select",
      { "aria-label": "State", onchange: () => this.draw() },
      h("option", { value: "" }, "all states"),
      Object.entries(STATES).map(([state, [name]]) => h("option", { value: state }, name)),
    );
    this.chosen = new Set();
    this.all = h("input", { type: "checkbox", id: "all-events", onchange: () => this.chooseAll() });
    this.many = h("button", { type: "button", class: "main", onclick: () => this.acknowledgeChosen() }, "Acknowledge the chosen ones");
    this.choice = h("div", { class: "bar choice" }, h("label", { for: "all-events" }, this.all, "all open ones shown"), this.many);
    this.machine = h("select", { "aria-label": "Machine", onchange: () => this.load() }, h("option", { value: "" }, "all machines"));
    for (const name of app.model.machines.keys()) this.machine.append(h("option", { value: name }, name));
    if (parameters.machine) this.machine.value = parameters.machine;
    this.shown = h("span", { class: "note right", role: "status" });
    this.list = h("ol", { class: "events", "aria-label": "Events" });
    this.state = h("div", { class: "empty" }, "reading the events …");
    this.older = h("button", { type: "button", class: "more", hidden: true, onclick: () => this.load(true) }, "Older events");
    this.element = h(
      "div",
      null,
      h("div", { class: "bar" }, h("h1", null, "Events"), this.which, this.machine, this.standing, this.search, this.shown),
      this.choice,
      this.state,
      this.list,
      this.older,
    );
    this.load();
  }

  get title() {
    return "Events";
  }

  async load(more = false) {
    const before = more && this.events.length ? this.events.at(-1).id : null;
    try {
      const answer = await get(`api/events${query({ machine: this.machine.value, limit: PAGE, before })}`);
      this.events = more ? [...this.events, ...answer.events] : answer.events;
      this.older.hidden = answer.events.length < PAGE;
      this.app.setUnacknowledged(answer.unacknowledged);
      this.failure = null;
    } catch (error) {
      this.failure = error;
    }
    this.draw();
  }

  draw() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const which = this.which.value;
    const fits = (event) => {
      const text = `${event.text} ${event.machine} ${event.channel ?? ""} ${event.kind}`.toLowerCase();
      const state = this.standing.value;
      return words.every((word) => text.includes(word)) && (which !== "open" || event.open) && (!state || stateOf(event) === state);
    };
    const events = this.events.filter(fits);
    if (which === "all") events.sort((a, b) => Number(b.open) - Number(a.open));
    this.drawn = events;
    // What is not shown is not chosen: nothing unseen is acknowledged.
    const open = new Set(this.openDrawn().map((event) => event.id));
    for (const id of this.chosen) if (!open.has(id)) this.chosen.delete(id);
    fill(this.list, events.map((event) => eventItem(this.app, event, (answer) => this.replace([answer]), {
      chosen: this.chosen.has(event.id),
      choose: (on) => this.choose(event.id, on),
    })));
    this.drawChoice();
    this.list.hidden = !events.length;
    this.shown.textContent = this.events.length ? fmt.counted(events.length, "event") : "";
    this.state.hidden = events.length > 0 && !this.failure;
    if (this.failure) fill(
      this.state,
      h("strong", null, "The events could not be read"),
      this.failure.message,
      " ",
      h("button", { type: "button", onclick: () => this.load() }, "Try again"),
    );
    else if (!this.events.length) fill(
      this.state,
      h("strong", null, "Nothing has happened yet"),
      "Alarms, the start of a final stage, silences and their acknowledgements will stand here.",
    );
    else fill(this.state, "No event fits the filter.");
  }

  /** The open events that are shown. */
  openDrawn() {
    return this.drawn.filter((event) => event.open);
  }

  choose(id, on) {
    if (on) this.chosen.add(id);
    else this.chosen.delete(id);
    this.drawChoice();
  }

  chooseAll() {
    this.chosen = new Set(this.all.checked ? this.openDrawn().map((event) => event.id) : []);
    for (const box of this.list.querySelectorAll('input[type="checkbox"]')) box.checked = this.all.checked;
    this.drawChoice();
  }

  drawChoice() {
    const open = this.openDrawn().length;
    const chosen = this.chosen.size;
    this.choice.hidden = open < 2;
    this.all.checked = chosen > 0 && chosen === open;
    this.all.indeterminate = chosen > 0 && chosen < open;
    this.many.disabled = !chosen;
    this.many.textContent = chosen ? `Acknowledge ${fmt.counted(chosen, "event")}` : "Acknowledge the chosen ones";
  }

  acknowledgeChosen() {
    const events = this.openDrawn().filter((event) => this.chosen.has(event.id));
    acknowledgeMany(this.app, events, (answers) => this.replace(answers));
  }

  replace(answers) {
    const changed = new Map(answers.map((answer) => [answer.id, answer]));
    for (const answer of answers) this.chosen.delete(answer.id);
    this.events = this.events.map((event) => changed.get(event.id) ?? event);
    this.draw();
    this.app.countEvents();
  }

  on(kind) {
    if (kind === "events") this.load();
    if (kind === "prefs") this.draw();
  }

  close() {}
}

/** The published files. */
export class Files {
  constructor(app) {
    this.app = app;
    this.body = h("div", null, h("div", { class: "empty" }, "reading the list of files …"));
    this.element = h("div", null, h("div", { class: "bar" }, h("h1", null, "Files")), this.body);
    this.load();
  }

  get title() {
    return "Files";
  }

  async load() {
    try {
      const { files } = await get("api/records");
      fill(
        this.body,
        files.length ? this.table(files) : h(
          "div",
          { class: "empty" },
          h("strong", null, "No file is published yet"),
          "The daemon writes one netCDF file a day and machine.",
        ),
      );
    } catch (error) {
      fill(this.body, h("div", { class: "empty" }, h("strong", null, "The list could not be read"), error.message));
    }
  }

  table(files) {
    const rows = files.map((file) => h("tr", null,
      h("td", null, h("a", { href: `records/${encodeURIComponent(file.file)}`, download: file.file }, file.file)),
      h("td", null, file.machine),
      h("td", null, fmt.bytes(file.bytes)),
      h("td", null, fmt.moment(fmt.fromIso(file.modified_utc) ?? file.modified_utc)),
    ));
    const heads = ["Health records (netCDF)", "Machine", "Size", "Written"].map((head) => h("th", { scope: "col" }, head));
    return h(
      "div",
      { class: "card scroll" },
      h(
        "table",
        null,
        h("caption", { class: "unseen" }, "Published files"),
        h("thead", null, h("tr", null, heads)),
        h("tbody", null, rows),
      ),
    );
  }

  on(kind) {
    if (kind === "prefs") this.load();
  }

  close() {}
}
