// The import desk: a folder is chosen, how it is read is shown and corrected, and a configuration is saved.

import { get, post, query } from "./api.js";
import { signInForm } from "./dialogs.js";
import { fill, h, table } from "./dom.js";
import { dateLine, signalPlot, spectrumPlot } from "./desk_plots.js";
import * as fmt from "./fmt.js";
import { columnKind, originWord, PART_NAMES } from "./words.js";

/** Answers that may be corrected at any time: label and an example; others come with their questions. */
const FIELDS = {
  bearing: ["Bearing", "6205-2RS, or 9 7.94 39.04"],
  speed_hz: ["Speed of the shaft", "29.5 Hz, 1770 rpm, estimate"],
  load_newton: ["Radial load", "400 N, 0.4 kN, unknown"],
  rate_hz: ["Sampling rate", "as the files state it"],
  unit: ["Unit of the vibration", "as the files state it"],
  sensitivity_mv_per_g: ["Sensitivity", "100 mV/g, for V"],
  timezone: ["Zone of dates that state none", "UTC"],
  name: ["Name of the machine", "that of the folder"],
};
/** Fields that are no answers to questions. */
const BESIDE = ["timezone", "name"];
const ID = "desk-answer-";
// Who does not import does not wait for its style.
document.head.append(h("link", { rel: "stylesheet", href: "static/desk.css" }));

export class Desk {
  constructor(app) {
    this.app = app;
    this.place = null;
    this.answers = {};
    this.columns = null;
    this.own = {};
    this.inputs = new Map();
    this.body = h("div", null);
    this.element = h("div", { class: "desk" }, h("div", { class: "bar" }, h("h1", null, "Import a recording")), this.body);
    this.begin();
  }

  get title() {
    return "Import";
  }

  begin() {
    if (this.app.session?.role === "admin") this.browse(null);
    else if (this.app.session?.authorized) {
      fill(this.body, h("p", { class: "wrong" }, `${this.app.session.user} is a ${this.app.session.role}; a recording is imported by an admin.`));
    } else {
      const form = signInForm(this.app, async () => {
        await this.app.readSession();
        this.begin();
      });
      fill(this.body, h("div", { class: "card" }, h("p", { class: "note" }, "Importing needs a sign-in as admin, or the token."), form));
    }
  }

  /** List a folder, or the folders that may be read. */
  async browse(path) {
    try {
      this.showFolder(await get(`api/desk${query({ path })}`));
    } catch (error) {
      fill(this.body, h("div", { class: "empty" }, h("strong", null, "The folder could not be read"), error.message));
    }
  }

  showFolder(found) {
    const open = (entry) => h("li", null, h("button", { type: "button", class: "entry", onclick: () => (entry.folder ? this.browse(entry.path) : this.choose(entry.path)) },
      h("span", { class: "what" }, entry.folder ? `${entry.name}/` : entry.name),
      h("span", { class: "note" }, entry.folder ? "open" : `${fmt.bytes(entry.bytes)}, read this file`)));
    const up = found.path !== null && h("button", { type: "button", onclick: () => this.browse(found.parent) }, found.parent === null ? "All folders" : "Up");
    const read = found.path !== null && h("button", { type: "button", class: "main", onclick: () => this.choose(found.path) }, "Read this folder");
    const more = found.more > 0 && h("p", { class: "note" }, `and ${fmt.counted(found.more, "more name")}`);
    fill(
      this.body,
      h("section", { class: "card", "aria-labelledby": "desk-folder" },
        h("h2", { id: "desk-folder", tabindex: "-1" }, found.path ?? "Which folder?"),
        h("div", { class: "buttons" }, up, read),
        found.entries.length ? h("ul", { class: "entries" }, found.entries.map(open)) : h("p", { class: "note" }, "It is empty."),
        more),
    );
    this.body.querySelector(found.path === null ? ".entry" : "h2")?.focus();
    this.app.say(found.path === null ? "Folders" : `${found.path}, ${fmt.counted(found.entries.length, "name")}`);
  }

  /** Read a folder or file; answers of another one are forgotten. */
  choose(path) {
    this.place = path;
    this.answers = {};
    this.columns = null;
    this.own = {};
    this.inputs.clear();
    this.form = h("div", { class: "fields" });
    this.said = h("p", { class: "wrong", role: "alert" });
    this.result = h("div", { class: "result" });
    this.update = h("button", { class: "main" }, "Read again");
    const form = h("form", { class: "card form", "aria-labelledby": "desk-answers", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      this.look();
    } },
      h("h2", { id: "desk-answers", tabindex: "-1" }, "What the files do not say"),
      this.form, this.said, h("div", { class: "buttons" }, this.update));
    fill(this.body,
      h("p", { class: "bar" }, h("button", { type: "button", onclick: () => this.browse(null) }, "Another folder"), h("code", { class: "path" }, path)),
      form, this.result);
    this.body.querySelector("h2").focus();
    this.look();
  }

  given() {
    const answers = {};
    const given = { path: this.place, answers };
    for (const [key, { input }] of this.inputs) if (input.value.trim()) (BESIDE.includes(key) ? given : answers)[key] = input.value.trim();
    if (this.columns) answers.columns = this.columns;
    for (const [key, all] of Object.entries(this.own)) {
      const own = Object.entries(all).filter(([title]) => !this.columns || this.columns.includes(title));
      if (own.length) answers[key] = { ...(answers[key] && { "": answers[key] }), ...Object.fromEntries(own) };
    }
    return given;
  }

  /** Ask how it is read; the answer to the newest request counts. */
  async look() {
    const turn = (this.turn = (this.turn ?? 0) + 1);
    this.update.disabled = true;
    this.body.setAttribute("aria-busy", "true");
    this.setWrong(null);
    try {
      const found = await post("api/desk/look", this.given());
      if (turn === this.turn) this.show(found);
    } catch (error) {
      if (turn === this.turn) this.setWrong(error);
    }
    if (turn !== this.turn) return;
    this.update.disabled = false;
    this.body.removeAttribute("aria-busy");
  }

  /** Say what is wrong, at the answer that it is about. */
  setWrong(error) {
    for (const { input, wrong } of this.inputs.values()) {
      input.removeAttribute("aria-invalid");
      fill(wrong);
    }
    fill(this.said);
    if (!error) return;
    const field = this.inputs.get(error.key);
    if (!field) {
      fill(this.said, error.message);
      return;
    }
    field.input.setAttribute("aria-invalid", "true");
    fill(field.wrong, error.message);
    field.input.focus();
    this.app.say(error.message);
  }

  show(found) {
    this.found = found;
    this.ask(found);
    const focused = this.result.contains(document.activeElement) ? document.activeElement.ariaLabel : null;
    fill(this.result, this.columnCard(found), this.factCard(found), this.drawings(found), this.checkCard(found), this.saveCard(found));
    if (focused) [...this.result.querySelectorAll("input")].find((input) => input.ariaLabel === focused)?.focus();
    const open = found.questions.filter((question) => question.default === null);
    this.app.say(open.length ? `${fmt.counted(open.length, "answer")} missing: ${open.map((question) => question.words).join(", ")}` : "The configuration is complete");
  }

  /** A field for each question, the open ones first, and for what may be corrected; a field that is there keeps its text. */
  ask(found) {
    const questions = new Map(found.questions.map((question) => [question.key, question]));
    // Columns are ticked below.
    questions.delete("columns");
    for (const [key, question] of questions) if (!this.inputs.has(key)) this.addField(key, FIELDS[key]?.[0] ?? question.words);
    for (const [key, [label]] of Object.entries(FIELDS)) if (!this.inputs.has(key)) this.addField(key, label);
    for (const [key, { input, why, element }] of this.inputs) {
      const question = questions.get(key);
      element.toggleAttribute("data-open", question?.default === null);
      input.placeholder = question?.proposed ?? question?.default ?? FIELDS[key]?.[1] ?? "";
      fill(why, question && h("span", null, question.default === null ? h("b", null, "An answer is needed. ") : `Without an answer: ${question.default}. `, question.why));
    }
    const rank = ({ element }) => (element.hasAttribute("data-open") ? 0 : 1);
    const sorted = [...this.inputs.values()].sort((one, other) => rank(one) - rank(other));
    const focused = document.activeElement;
    if (!this.form.contains(focused)) fill(this.form, sorted.map(({ element }) => element));
    else for (const { element } of sorted) if (!element.isConnected) this.form.append(element);
  }

  addField(key, label) {
    const why = h("span", { class: "note", id: `${ID}${key}-why` });
    const wrong = h("span", { class: "wrong", id: `${ID}${key}-wrong`, role: "alert" });
    const input = h("input", { id: `${ID}${key}`, name: key, autocomplete: "off", spellcheck: "false", "aria-describedby": `${why.id} ${wrong.id}` });
    const element = h("div", { class: "field" }, h("label", { for: input.id }, label), input, wrong, why);
    this.inputs.set(key, { input, why, wrong, element });
  }

  columnCard(found) {
    const rows = found.columns.map((column) => {
      const box = h("input", { type: "checkbox", "aria-label": `${column.title} is vibration`, onchange: () => this.chooseColumns() });
      box.checked = column.taken;
      box.value = column.title;
      const level = column.rms_g === null ? fmt.number(column.rms) : fmt.withUnit(column.rms_g, "g");
      const unit = this.unitCell(column);
      const why = column.written ? `${column.place}, written “${column.written}”` : column.place;
      return [box, h("b", null, column.title), column.taken ? columnKind("vibration") : `${columnKind(column.kind)}${column.evidence ? `: ${column.evidence}` : ""}`,
        column.taken ? [h("span", { class: "narrow" }, "unit "), unit] : "", [h("span", { class: "narrow" }, "RMS "), level], h("span", { class: "note" }, why)];
    });
    this.boxes = rows.map(([box]) => box);
    const asked = found.questions.find((question) => question.key === "columns");
    return h("section", { class: "card" }, h("h2", null, "Columns"), asked && h("p", { class: "wrong" }, `${asked.why} Tick those that are.`),
      table("Columns of the first file", ["Taken", "Column", "Read as", "Unit", "RMS", "By"], rows, "stacked"));
  }

  /** The unit of a column; what the file leaves open is answered there for this column alone. */
  unitCell(column) {
    const read = column.unit === null ? h("b", null, "open") : `${column.unit} (${originWord(column.origin)})`;
    const field = (key, label, hint) => {
      const own = (this.own[key] ??= {});
      const input = h("input", { class: "own", name: `${key}:${column.title}`, "aria-label": `${label} of ${column.title}`, placeholder: hint, autocomplete: "off", spellcheck: "false", onchange: () => this.look(), oninput: () => {
        // What is typed while an answer to the last request comes is kept.
        if (input.value.trim()) own[column.title] = input.value.trim();
        else delete own[column.title];
      } });
      input.value = own[column.title] ?? "";
      return input;
    };
    if (!column.taken) return read;
    return [read, column.origin !== "stated" && field("unit", "Unit", column.unit ?? "g, m/s2, mV"),
      column.unit === "V" && field("sensitivity_mv_per_g", "Sensitivity", column.sensitivity_mv_per_g === null ? "100 mV/g" : `${fmt.number(column.sensitivity_mv_per_g)} mV/g`)];
  }

  chooseColumns() {
    const taken = this.boxes.filter((box) => box.checked).map((box) => box.value);
    if (!taken.length) {
      fill(this.said, "At least one column is vibration.");
      return;
    }
    const place = this.boxes.indexOf(document.activeElement);
    this.columns = taken;
    this.look().then(() => this.boxes[place]?.focus());
  }

  factCard(found) {
    const rows = found.facts.map((fact) => [fact.words, fact.value === null ? h("b", null, "open") : fact.value, h("span", { class: "note" }, originWord(fact.origin)), h("span", { class: "note" }, fact.place)]);
    return h("section", { class: "card" }, h("h2", null, "What is known"), table("Facts of the recording", ["Fact", "Value", "From", "By"], rows, "stacked"), dateLine(found.dates));
  }

  drawings(found) {
    if (!found.channels.length) return h("section", { class: "card" }, h("h2", null, "Signal"), h("p", { class: "note" }, "It is drawn once a column is taken and the sampling rate is known."));
    return found.channels.map((channel) => h("section", { class: "card" }, h("h2", null, channel.name),
      h("p", null, `RMS ${fmt.withUnit(channel.rms, channel.unit || "of unknown unit")}, peak ${fmt.withUnit(channel.peak, channel.unit || "of unknown unit")}`, channel.bearing && `; bearing ${channel.bearing}`),
      h("div", { class: "plots" }, signalPlot(channel), spectrumPlot(channel)), this.lines(channel)));
  }

  lines(channel) {
    const parts = Object.entries(channel.lines_hz);
    if (!parts.length) return null;
    const rows = parts.map(([part, lines]) => [h("span", { class: "part", "data-part": part }, PART_NAMES[part] ?? part), ...lines.map((line) => fmt.number(line, 4))]);
    return table(`First lines of ${channel.name}, Hz`, ["Lines, Hz", "1", "2", "3", "4", "5"], rows, "lines");
  }

  checkCard(found) {
    if (!found.doubts) return null;
    const ends = found.ends.map((text) => h("li", null, text));
    const doubts = found.doubts.map((doubt) => h("li", { "data-severity": doubt.severity }, h("b", null, `${doubt.severity}: `), `${doubt.key}: ${doubt.came}; expected ${doubt.expected}`));
    return h("section", { class: "card" }, h("h2", null, "What check says"), h("p", { class: "note" }, "The first and the last file, as they are read:"), h("ul", { class: "plain" }, ends),
      doubts.length ? h("ul", { class: "doubts" }, doubts) : h("p", null, "Nothing is doubtful."));
  }

  saveCard(found) {
    if (!found.configuration) return null;
    const name = h("input", { id: "desk-file", value: `${found.machine}.toml`, autocomplete: "off", spellcheck: "false" });
    const said = h("p", { role: "status", class: "saved" });
    const save = async (event) => {
      event.preventDefault();
      try {
        const { file, next } = await post("api/desk/save", { ...this.given(), file: name.value.trim() });
        said.className = "saved";
        fill(said, `Saved as ${file}. Next on the machine: `, h("code", null, next));
      } catch (error) {
        said.className = "saved wrong";
        fill(said, error.message);
        name.select();
      }
    };
    return h("section", { class: "card" }, h("h2", null, "Configuration"),
      h("details", null, h("summary", null, "Look at the file"), h("pre", { tabindex: "0", "aria-label": "The configuration" }, found.configuration)),
      h("form", { class: "form", onsubmit: save }, h("label", { for: name.id }, "Name of the file, beside the other configurations; none is replaced"), name, said,
        h("div", { class: "buttons" }, h("button", { class: "main" }, "Save"))));
  }

  on() {}

  close() {
    this.turn = -1;
  }
}
