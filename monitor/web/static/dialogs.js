// Dialogs: help, signing in, an acknowledgement.

import { eventPath, get, post } from "./api.js";
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

/** For admins: each user, and a link that lets the user choose a password. */
async function invitations(box) {
  try {
    const { users } = await get("api/users");
    if (users.length) fill(box, h("h3", null, "Users"), h("ul", { class: "users" }, users.map((user) => userItem(user))));
  } catch (error) {
    fill(box, h("p", { class: "wrong" }, error.message));
  }
}

function userItem(user) {
  const said = h("span", { class: "note", role: "status" });
  const ask = async () => {
    try {
      const { code, until_utc: until } = await post("api/users/invite", { name: user.name });
      const link = `${location.href.split("#")[0]}#/invite/${code}`;
      fill(said, `Send this link; it is valid once, until ${until}: `, h("code", null, link));
    } catch (error) {
      fill(said, error.message);
    }
  };
  const button = h("button", { type: "button", "aria-label": `Invite ${user.name}`, onclick: ask }, "Invite");
  return h("li", null, `${user.name}, ${user.role} `, button, said);
}

/** Shortcuts, and what the symbols mean. */
export function showHelp(app) {
  const { version } = app.model;
  const keys = SHORTCUTS.map(([key, what]) => [h("dt", null, h("kbd", null, key)), h("dd", null, what)]);
  const states = STATE_ORDER.map((state) => [
    h("dt", { "data-state": state }, symbol(state)),
    h("dd", null, h("b", null, STATES[state][0]), `: ${STATES[state][1]}`),
  ]);
  const users = h("div");
  if (app.session?.role === "admin") invitations(users);
  const dialog = show(
    "Help",
    h("dl", { class: "keys" }, states),
    h("p", { class: "note" }, "In charts: drag to zoom, Ctrl and wheel to zoom where the pointer is, double click for the whole time."),
    h("dl", { class: "keys" }, keys),
    users,
    h(
      "div",
      { class: "buttons" },
      h("span", { class: "note" }, version ? `spallwatch ${version}` : ""),
      app.session?.user && h("span", { class: "note" }, `${app.session.user}, ${app.session.role}`),
      app.session?.authorized && h("button", { type: "button", onclick: () => app.logOut() }, "Log out"),
      h("button", { type: "button", class: "main", onclick: () => dialog.close() }, "Close"),
    ),
  );
}

const WAYS = {
  name: {
    label: "Name and password",
    note: "Whoever looks after this monitor adds users: spallwatch user add NAME.",
    fields: () => [field("Name", "name", "text", "username"), field("Password", "password", "password", "current-password")],
  },
  code: {
    label: "A code of an invitation",
    note: "It is valid once, for a day; it comes from spallwatch user invite NAME, or from an admin.",
    fields: () => [
      field("Code", "code", "text", "one-time-code"),
      field("New password, 10 characters or more", "password", "password", "new-password"),
    ],
  },
  token: {
    label: "The token",
    note: "It stands in the file web.token in the machine's state folder, unless token_file names another.",
    fields: () => [field("Token", "token", "password", "current-password")],
  },
};

function field(label, name, type, autocomplete) {
  return h("label", null, label, h("input", { type, name, autocomplete, required: true }));
}

/** The code of an invitation in the address, or null. */
export const invitation = () => /^#\/invite\/([\w-]+)$/.exec(location.hash)?.[1] ?? null;

/** A form to sign in: by name, by an invitation or by the token; calls back when the server took it. */
export function signInForm(app, onDone) {
  const code = invitation();
  const box = h("div");
  const show = (way) => fill(box, wayForm(way, code, onDone), others(way, show));
  show(code ? "code" : app.session?.users ? "name" : "token");
  return box;
}

function others(way, show) {
  const rest = Object.keys(WAYS).filter((name) => name !== way);
  return h("p", { class: "note ways" }, "Or with: ", rest.map((name) =>
    h("button", { type: "button", class: "quiet", onclick: () => show(name) }, WAYS[name].label.toLowerCase())));
}

function wayForm(way, code, onDone) {
  const wrong = h("p", { class: "wrong", role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    fill(wrong);
    const { form } = event.submitter ?? { form: event.target };
    const given = Object.fromEntries(new FormData(form));
    for (const name of ["name", "code", "token"]) if (name in given) given[name] = given[name].trim();
    try {
      await post("login", given);
      // The address keeps no code that is used up.
      if (invitation()) history.replaceState(null, "", "#/");
      onDone();
    } catch (error) {
      fill(wrong, error.status === 401 || error.status === 403 ? `Not accepted: ${error.message}` : error.message);
      form.querySelector("input").select();
    }
  };
  const form = h(
    "form",
    { class: "form", onsubmit: submit },
    WAYS[way].fields(),
    h("p", { class: "note" }, WAYS[way].note),
    wrong,
    h("div", { class: "buttons" }, h("button", { class: "main" }, "Log in")),
  );
  if (way === "code" && code) form.elements.code.value = code;
  return form;
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
  const ask = () => fill(body, h("p", { class: "note" }, "Acknowledging needs a sign-in, once a session."), signInForm(app, async () => {
    await app.readSession();
    next();
  }));
  const refused = () => fill(body, h("p", { class: "wrong" }, `${app.session.user} is a ${app.session.role}, and may only read.`));
  const next = () => (app.session?.can_acknowledge ? form() : app.session?.authorized ? refused() : ask());
  next();
  body.querySelector("input")?.focus();
}

function acknowledgeForm(app, dialog, ask, send) {
  const who = h("input", { name: "who", required: true, maxlength: "100", autocomplete: "name" });
  // Who has signed in by name acknowledges under it.
  who.value = app.session?.user ?? remembered();
  who.readOnly = Boolean(app.session?.user);
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
