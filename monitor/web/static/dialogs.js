// Dialogs: help, the token, an acknowledgement.

import { post, eventPath } from "./api.js";
import { fill, h, symbol } from "./dom.js";
import { STATES, STATE_ORDER } from "./words.js";

const NAME = "spallwatch.who";

function show(title, ...content) {
  const dialog = h("dialog", { "aria-labelledby": "dialog-title" }, h("h2", { id: "dialog-title" }, title), content);
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

const SHORTCUTS = [
  ["M", "machines"], ["E", "events"], ["/", "filter"], ["Z", "times in UTC or in the machine's zone"],
  ["D", "light, dark, as the system"], ["?", "this help"],
  ["+  −", "zoom in and out in time (on the trends)"], ["←  →", "move in time (trends), other spectrum (waterfall)"],
  ["0", "the whole time (on the trends)"], ["Esc", "close a dialog"],
];

/** Shortcuts, and what the symbols mean. */
export function showHelp(app) {
  const { version } = app.model;
  const keys = SHORTCUTS.map(([key, what]) => [h("dt", null, h("kbd", null, key)), h("dd", null, what)]);
  const states = STATE_ORDER.map((state) => [
    h("dt", { "data-state": state }, symbol(state)),
    h("dd", null, h("b", null, STATES[state][0]), `: ${STATES[state][1]}`),
  ]);
  const dialog = show(
    "Help",
    h("dl", { class: "keys" }, states),
    h("p", { class: "note" }, "In charts: drag to zoom, Ctrl and wheel to zoom where the pointer is, double click for the whole time."),
    h("dl", { class: "keys" }, keys),
    h(
      "div",
      { class: "buttons" },
      h("span", { class: "note" }, version ? `spallwatch ${version}` : ""),
      app.session?.authorized && h("button", { type: "button", onclick: () => app.logOut() }, "Log out"),
      h("button", { type: "button", class: "main", onclick: () => dialog.close() }, "Close"),
    ),
  );
}

/** A form that asks for the token; calls back when the server took it. */
export function tokenForm(onDone) {
  const token = h("input", { type: "password", autocomplete: "current-password", required: true, name: "token" });
  const wrong = h("p", { class: "wrong", role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    fill(wrong);
    try {
      await post("login", { token: token.value.trim() });
      onDone();
    } catch (error) {
      fill(wrong, error.status === 401 || error.status === 403 ? `The token was not accepted: ${error.message}` : error.message);
      token.select();
    }
  };
  return h(
    "form",
    { class: "form", onsubmit: submit },
    h("label", null, "Token", token),
    h("p", { class: "note" }, "It stands in the file web.token in the machine's state folder, unless token_file names another."),
    wrong,
    h("div", { class: "buttons" }, h("button", { class: "main" }, "Log in")),
  );
}

function remembered() {
  try {
    return sessionStorage.getItem(NAME) ?? "";
  } catch {
    return "";
  }
}

function remember(who) {
  try {
    sessionStorage.setItem(NAME, who);
  } catch {
    // The name is asked for again.
  }
}

/** Ask who acknowledges an event, with which words; calls back with the event as the server has it then. */
export function acknowledge(app, event, onDone) {
  const send = async (given) => {
    onDone(await post(`${eventPath(event.id)}/acknowledge`, given));
    return "Acknowledged";
  };
  askWho(app, "Acknowledge", h("p", { class: "note" }, event.text), send);
}

const AT_ONCE = 100;
const LISTED = 8;

/** The same of several events with one note; calls back with those that the server has changed. */
export function acknowledgeMany(app, events, onDone) {
  const lines = events.slice(0, LISTED).map((event) => h("li", null, `${event.machine}: ${event.text}`));
  if (events.length > LISTED) lines.push(h("li", null, `and ${events.length - LISTED} more`));
  const send = async (given) => {
    const results = [];
    for (let at = 0; at < events.length; at += AT_ONCE) {
      const names = events.slice(at, at + AT_ONCE).map((event) => event.id);
      results.push(...(await post("api/acknowledge", { ...given, events: names })).results);
    }
    onDone(results.map((result) => result.event).filter(Boolean));
    const failed = results.filter((result) => result.error);
    if (failed.length) throw new Error(`${failed.length} of ${events.length} could not be acknowledged: ${failed[0].error}`);
    return `Acknowledged ${events.length} events`;
  };
  askWho(app, `Acknowledge ${events.length} events`, h("ul", { class: "note" }, lines), send);
}

/** Ask for name and note, before that for a login where there is none; `send` returns what is then said. */
function askWho(app, title, about, send) {
  const body = h("div");
  const dialog = show(title, about, body);
  const form = () => fill(body, acknowledgeForm(app, dialog, ask, send));
  const ask = () => fill(body, h("p", { class: "note" }, "Acknowledging needs the token of this page, once a session."), tokenForm(async () => {
    await app.readSession();
    form();
  }));
  if (app.session?.authorized) form();
  else ask();
  body.querySelector("input")?.focus();
}

function acknowledgeForm(app, dialog, ask, send) {
  const who = h("input", { name: "who", required: true, maxlength: "100", autocomplete: "name" });
  who.value = remembered();
  const note = h("textarea", { name: "note", rows: "3", maxlength: "2000" });
  const wrong = h("p", { class: "wrong", role: "alert" });
  const submit = async (press) => {
    press.preventDefault();
    fill(wrong);
    try {
      const said = await send({ who: who.value.trim(), note: note.value });
      remember(who.value.trim());
      dialog.close();
      app.say(said);
    } catch (error) {
      if (error.status === 401) ask();
      else fill(wrong, error.message);
    }
  };
  return h(
    "form",
    { onsubmit: submit },
    h("label", null, "Your name", who),
    h("label", null, "Note (what was found, what is done)", note),
    wrong,
    h(
      "div",
      { class: "buttons" },
      h("button", { type: "button", onclick: () => dialog.close() }, "Cancel"),
      h("button", { class: "main" }, "Acknowledge"),
    ),
  );
}
