// The stream of what is new: opened again with growing pauses whenever it ends, and never silently dead.

import { get, query } from "./api.js";

const KINDS = ["machines", "records", "spectrum", "events"];
const LONGEST_PAUSE = 30_000;
const QUIET = 25_000;

export class Live {
  /**
   * @param onEvent called with the kind and the data of each event
   * @param onState called with {live, since}: since when it is not live (ms)
   */
  constructor(onEvent, onState) {
    this.onEvent = onEvent;
    this.onState = onState;
    this.failures = 0;
    this.since = null;
    this.subject = null;
    setInterval(() => this.probe(), QUIET / 2);
    addEventListener("online", () => this.open());
  }

  /** Follow everything, and one channel more closely where one is named. */
  follow(machine, channel) {
    const subject = query({ machine, channel });
    if (subject === this.subject && this.source) return;
    this.subject = subject;
    this.open();
  }

  open() {
    clearTimeout(this.timer);
    this.source?.close();
    const source = new EventSource(`api/stream${this.subject ?? ""}`);
    this.source = source;
    source.onopen = () => this.alive();
    source.onerror = () => this.lost(source);
    for (const kind of KINDS) {
      source.addEventListener(kind, (event) => {
        this.alive();
        this.onEvent(kind, JSON.parse(event.data));
      });
    }
  }

  alive() {
    this.received = Date.now();
    this.failures = 0;
    this.since = null;
    this.onState({ live: true, since: null });
  }

  lost(source) {
    if (source !== this.source) return;
    source.close();
    this.source = null;
    this.since ??= Date.now();
    const pause = Math.min(LONGEST_PAUSE, 1000 * 2 ** Math.min(this.failures, 5)) * (0.8 + 0.4 * Math.random());
    this.failures += 1;
    this.timer = setTimeout(() => this.open(), pause);
    this.onState({ live: false, since: this.since });
  }

  /** A connection can end without an event; after a silence the server is asked. */
  async probe() {
    const source = this.source;
    if (!source || Date.now() - (this.received ?? 0) < QUIET) return;
    try {
      await get("api/session", AbortSignal.timeout(10_000));
      this.received = Date.now();
    } catch {
      this.lost(source);
    }
  }
}
