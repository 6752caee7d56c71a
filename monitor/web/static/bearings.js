// What the channels of each bearing say together, one line a bearing: verdicts first, then hints.

import { channelHref } from "./api.js";
import { arrange, h, setAttribute, setText } from "./dom.js";
import * as fmt from "./fmt.js";
import { baseSentence, baseWord, faultWords, levelSentence } from "./words.js";

const MANY = 12;
const ORDER = ["verdict", "hint"];

/** Which channels name another part, as a sentence. */
export const disagreement = (found) =>
  Object.entries(found.disagreement ?? {}).map(([channel, fault]) => `${channel} says ${faultWords(fault)}`).join("; ");

/** The support of a name in words, "" without one. */
export const support = (found) => (fmt.isNumber(found.support) ? `support ${fmt.percent(found.support)}` : "");

class Line {
  constructor(machine, bearing) {
    this.link = h("a", null, h("span", { class: "of" }, `${machine} / `), bearing);
    [this.part, this.basis, this.support, this.others] = ["part", "basis", "support", "others"].map((name) => h("span", { class: name }));
    this.element = h("li", { class: "bearing" }, this.link, this.part, this.basis, this.support, this.others);
  }

  update(machine, bearing, found, stale) {
    // The channels that agree say most about it.
    const channel = found.channels?.find((name) => !(name in (found.disagreement ?? {})));
    setAttribute(this.link, "href", channel ? channelHref(machine, channel) : null);
    setAttribute(this.element, "data-basis", found.fault_basis ?? "none");
    setAttribute(this.element, "data-stale", stale ? "" : null);
    setText(this.part, faultWords(found.fault) || "no part named");
    setText(this.basis, baseWord(found.fault_basis));
    setAttribute(this.basis, "title", baseSentence(found.fault_basis) || null);
    setText(this.support, support(found));
    setText(this.others, disagreement(found) || levelSentence(found.level_of));
    this.named = Boolean(found.fault);
    const place = ORDER.indexOf(found.fault_basis);
    this.order = [place < 0 ? ORDER.length : place, -(found.support ?? 0), machine, bearing];
    this.words = `${machine} ${bearing} ${this.element.textContent}`.toLowerCase();
  }
}

export class Bearings {
  constructor(compare) {
    this.compare = compare;
    this.lines = new Map();
    this.list = h("ul", { class: "rows" });
    this.rest = h("p", { class: "note" });
    this.element = h("section", { class: "bearings", "aria-label": "Bearings" }, this.list, this.rest);
  }

  /** Take over what the model knows now. */
  update(model) {
    const seen = new Set();
    for (const machine of model.machines.values()) {
      const stale = model.silence(machine) !== null;
      for (const [bearing, found] of Object.entries(machine.bearings ?? {})) {
        const key = JSON.stringify([machine.name, bearing]);
        seen.add(key);
        if (!this.lines.has(key)) this.lines.set(key, new Line(machine.name, bearing));
        this.lines.get(key).update(machine.name, bearing, found, stale);
      }
    }
    for (const key of this.lines.keys()) if (!seen.has(key)) this.lines.delete(key);
    const sorted = [...this.lines.values()].sort((a, b) => this.compare(a.order, b.order));
    arrange(this.list, sorted.map((line) => line.element));
  }

  /** Show the lines that have all wanted words; of many bearings only those with a name. */
  filter(wanted) {
    const lines = [...this.lines.values()].filter((line) => wanted.every((word) => line.words.includes(word)));
    const short = lines.length > MANY;
    const shown = new Set(lines.filter((line) => line.named || !short));
    for (const line of this.lines.values()) line.element.hidden = !shown.has(line);
    setText(this.rest, short && shown.size < lines.length ? `${fmt.counted(lines.length - shown.size, "bearing")} without a name` : "");
    this.list.hidden = shown.size === 0;
    this.element.hidden = lines.length === 0;
  }
}
