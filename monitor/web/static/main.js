// Starts the page: which view is shown, what is live, what the header says.

import { get, post } from "./api.js";
import { invitation, signInForm } from "./dialogs.js";
import { fill, h, setText } from "./dom.js";
import * as fmt from "./fmt.js";
import { Live } from "./live.js";
import { Model } from "./model.js";
import { Overview } from "./overview.js";
import { applyTheme, choose, onPrefs, prefs } from "./prefs.js";

const THEMES = ["auto", "light", "dark"];
const at = (id) => document.getElementById(id);

class App {
  constructor() {
    this.model = new Model();
    this.view = null;
    this.session = null;
    this.failure = null;
    this.broken = new Set();
    this.live = new Live((kind, data) => this.on(kind, data), (state) => this.setLive(state));
  }

  async start() {
    applyTheme();
    onPrefs((key) => this.prefsChanged(key));
    addEventListener("hashchange", () => this.route());
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("error", (event) => this.complain(event.message));
    addEventListener("unhandledrejection", (event) => this.complain(event.reason?.message ?? String(event.reason)));
    // Paper is white.
    addEventListener("beforeprint", () => this.printTheme("light"));
    addEventListener("afterprint", () => this.printTheme(null));
    at("zone").onclick = () => this.nextZone();
    at("theme").onclick = () => this.nextTheme();
    at("help").onclick = () => this.help();
    this.labels();
    setInterval(() => this.banners(), 1000);
    // The header's height decides where group titles stick.
    new ResizeObserver(
      ([entry]) => document.documentElement.style.setProperty("--top", `${entry.target.offsetHeight}px`),
    ).observe(document.querySelector(".top"));
    // What the view needs comes while the machines are read.
    this.module(this.parts()[0]).catch(() => null);
    const [session] = await Promise.all([this.readSession(), this.readMachines()]);
    if (session && !session.authorized && (session.needs_token || invitation())) this.login();
    else await this.begin();
  }

  async begin() {
    this.begun = true;
    await this.route();
    this.countEvents();
    // The next click finds its view at hand.
    globalThis.requestIdleCallback?.(() => this.module("channel").catch(() => null), { timeout: 5000 });
  }

  /** What the address names. */
  parts() {
    return location.hash.slice(1).split("?")[0].split("/").filter(Boolean).map(decodeURIComponent);
  }

  /** The module of a view, read when it is first needed. */
  async module(view) {
    if (view === "channel") return import("./channel.js");
    if (view === "import") return import("./desk.js");
    return view === "events" || view === "files" ? import("./events.js") : null;
  }

  async readSession() {
    this.session = await get("api/session").catch(() => null);
    at("nav-import").hidden = !this.session?.desk;
    return this.session;
  }

  async readMachines() {
    try {
      const answer = await get("api/machines");
      this.model.setServer(answer.server);
      this.model.take(answer.machines);
      this.failure = null;
    } catch (error) {
      this.failure = error;
    }
    this.view?.on("failure");
  }

  login() {
    const form = signInForm(this, async () => {
      await Promise.all([this.readSession(), this.readMachines()]);
      await this.begin();
    });
    fill(at("content"), h("div", { class: "empty" }, h("strong", null, invitation() ? "Choose a password" : "Sign in to this page"), form));
    document.title = "Log in – spallwatch";
  }

  /** Show what the address names. */
  async route() {
    if (!this.begun) return;
    const parts = this.parts();
    const search = location.hash.split("?")[1];
    const turn = (this.turn = (this.turn ?? 0) + 1);
    let make = () => new Overview(this);
    let current = "machines";
    if (parts[0] === "channel" && parts.length === 3) {
      const { Channel } = await this.module("channel");
      make = () => new Channel(this, parts[1], parts[2]);
    } else if (parts[0] === "events" || parts[0] === "files") {
      const { Events, Files } = await this.module("events");
      current = parts[0];
      make = () => (current === "files" ? new Files(this) : new Events(this, Object.fromEntries(new URLSearchParams(search))));
    }
    if (parts[0] === "import" && this.session?.desk) {
      const { Desk } = await this.module("import");
      current = "import";
      make = () => new Desk(this);
    }
    if (turn !== this.turn) return;
    this.view?.close();
    this.live.follow(...(parts[0] === "channel" ? parts.slice(1) : []));
    this.view = make();
    fill(at("content"), this.view.element);
    this.view.entered?.();
    for (const name of ["machines", "events", "files", "import"]) {
      if (name === current && parts[0] !== "channel") at(`nav-${name}`).setAttribute("aria-current", "page");
      else at(`nav-${name}`).removeAttribute("aria-current");
    }
    scrollTo(0, 0);
    if (this.routed) at("content").focus({ preventScroll: true });
    this.routed = true;
    this.setTitle();
  }

  on(kind, data) {
    if (kind === "machines") {
      if (data.full === false) this.model.merge(data.machines);
      else this.model.take(data.machines);
      if (data.server) this.model.setServer(data.server);
      this.failure = null;
    }
    if (kind === "events") this.setUnacknowledged(data.unacknowledged);
    this.view?.on(kind, data);
  }

  async countEvents() {
    try {
      this.setUnacknowledged((await get("api/events?limit=1")).unacknowledged);
    } catch (error) {
      this.complain(`The events could not be counted: ${error.message}`);
    }
  }

  setUnacknowledged(many) {
    this.model.unacknowledged = many ?? 0;
    const badge = at("badge");
    badge.hidden = !many;
    setText(badge, fmt.count(many));
    badge.setAttribute("aria-label", `, ${fmt.counted(many, "event")} to acknowledge`);
    this.setTitle();
  }

  setTitle() {
    const many = this.model.unacknowledged;
    document.title = `${many ? `(${many}) ` : ""}${this.view?.title ?? ""} – spallwatch`;
  }

  setLive(state) {
    this.model.live = state;
    const dot = at("live");
    dot.dataset.live = String(state.live);
    setText(dot, state.live ? "live" : "not live");
    this.banners();
    if (!state.live && this.begun) this.checkSession();
  }

  /** Where the stream is refused because a login has ended, a new one is asked for. */
  async checkSession() {
    const session = await this.readSession();
    if (!session?.needs_token || session.authorized || !this.begun) return;
    this.begun = false;
    this.view?.close();
    this.view = null;
    this.login();
  }

  async logOut() {
    await post("logout");
    location.reload();
  }

  /** What everybody must see: a lost connection, a daemon that does not run, a failure of the page itself. */
  banners() {
    const found = [];
    const { live, since } = this.model.live;
    if (!live && since && Date.now() - since > 2500) {
      // No countdown: every change of this text is read out.
      found.push(
        [
          "bad",
          `Not live since ${fmt.clock(since / 1000, this.zone(null))}: what is shown is as old as that. It is tried again and again.`,
        ],
      );
    }
    document.body.toggleAttribute("data-not-live", found.length > 0);
    const problems = this.model.problems(this.view?.machine ?? null);
    for (const { machine, text } of problems.slice(0, 4)) found.push(["warn", `${machine}: ${text}`]);
    if (problems.length > 4) found.push(["warn", `and ${fmt.counted(problems.length - 4, "more problem")}`]);
    for (const text of this.broken) found.push(["bad", text]);
    const shown = JSON.stringify(found);
    if (shown === this.shownBanners) return;
    this.shownBanners = shown;
    fill(at("banners"), found.map(([kind, text]) => h("div", { class: "banner", "data-kind": kind }, text)));
  }

  /** Something failed that should not: said, not swallowed. */
  complain(text) {
    this.broken.add(text);
    this.banners();
    setTimeout(() => this.broken.delete(text), 15_000);
  }

  say(text) {
    setText(at("said"), text);
  }

  /** The zone in which times of a machine are shown. */
  zone(machine) {
    return prefs.zone === "utc" || machine === null ? "UTC" : fmt.knownZone(this.model.zone(machine));
  }

  nextZone() {
    choose("zone", prefs.zone === "utc" ? "machine" : "utc");
  }

  nextTheme() {
    choose("theme", THEMES[(THEMES.indexOf(prefs.theme) + 1) % THEMES.length]);
  }

  printTheme(theme) {
    applyTheme();
    if (theme) document.documentElement.dataset.theme = theme;
    this.view?.on("prefs", "theme");
  }

  labels() {
    const label = (name, what, value) => fill(at(name), h("span", { class: "what" }, `${what}: `), value);
    label("zone", "Times", prefs.zone === "utc" ? "UTC" : "machine's");
    label("theme", "Theme", prefs.theme);
  }

  prefsChanged(key) {
    this.labels();
    this.view?.on("prefs", key);
  }

  async help() {
    const { showHelp } = await import("./dialogs.js");
    showHelp(this);
  }

  key(event) {
    const typing = event.target.closest("input, textarea, select, dialog");
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      m: () => (location.hash = "#/"),
      e: () => (location.hash = "#/events"),
      z: () => this.nextZone(),
      d: () => this.nextTheme(),
      "?": () => this.help(),
      "/": () => at("content").querySelector('input[type="search"]')?.focus(),
    };
    const action = actions[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  }
}

const app = new App();
await app.start();
