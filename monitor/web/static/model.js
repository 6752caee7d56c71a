// What is known of all machines, and how old it is.

import { fromIso, isNumber } from "./fmt.js";
import { STATES, daemonSentence, knownState } from "./words.js";

const STALE_AFTER = 20;

/** What a refusing daemon or a silent one makes of a state: never better than "no data". */
function standing(machine, channel, silence) {
  const state = knownState(channel?.state);
  if (!silence) return { state, reason: channel?.reason ?? STATES[state][1], stale: false };
  const last = channel?.state ? `; last said: ${STATES[state][0].toLowerCase()}` : "";
  return { state: state === "failure" ? state : "no_data", reason: silence + last, stale: true };
}

export class Model {
  constructor() {
    this.machines = new Map();
    this.zones = new Map();
    this.loaded = false;
    this.unacknowledged = 0;
    this.offset = 0;
    this.live = { live: false, since: null };
  }

  /** Seconds since 1970 by the server's clock. */
  now() {
    return Date.now() / 1000 + this.offset;
  }

  setServer(server) {
    const utc = isNumber(server?.utc) ? server.utc : fromIso(server?.utc);
    if (utc !== null) this.offset = utc - Date.now() / 1000;
    this.version = server?.version;
  }

  /** Take all machines as the server gives them. */
  take(machines) {
    this.loaded = true;
    this.machines.clear();
    this.merge(machines);
  }

  /** Take what changed: the keys of a machine, and whole channels of it. */
  merge(machines) {
    const receivedAt = Date.now() / 1000;
    // Ages count from when the daemon wrote them, which for one that does not run may be long ago.
    for (const machine of machines) {
      const known = this.machines.get(machine.name);
      const came = Object.entries(machine.channels ?? {}).map(([name, status]) => [name, { ...status, receivedAt, writtenAt: fromIso(machine.updated_utc) }]);
      const channels = { ...known?.channels, ...Object.fromEntries(came) };
      this.machines.set(machine.name, { ...machine, channels, receivedAt });
    }
  }

  /** Why nothing can be expected of a machine by now, or null. */
  silence(machine) {
    if (machine.running === false) return daemonSentence(machine.status).replace(/^The/, "the");
    const updated = fromIso(machine.updated_utc);
    if (updated !== null && this.now() - updated > STALE_AFTER && Date.now() / 1000 - machine.receivedAt > STALE_AFTER)
      return "the daemon does not report";
    return null;
  }

  /** All channels of all machines, and the machines that have none, as rows. */
  rows() {
    const rows = [];
    for (const machine of this.machines.values()) {
      const silence = this.silence(machine);
      const channels = Object.entries(machine.channels ?? {});
      if (!channels.length)
        rows.push({ machine: machine.name, channel: null, status: {}, ...standing(machine, null, silence ?? "it has said nothing yet") });
      for (const [name, status] of channels)
        rows.push({ machine: machine.name, channel: name, status, ...standing(machine, status, silence) });
    }
    return rows;
  }

  /** One channel as a row, or null. */
  row(machineName, channelName) {
    const machine = this.machines.get(machineName);
    const status = machine?.channels?.[channelName];
    if (!status) return null;
    return { machine: machineName, channel: channelName, status, ...standing(machine, status, this.silence(machine)) };
  }

  /** Seconds since the latest block came, or null. */
  age(row) {
    const { last_block_age_s: then, writtenAt, receivedAt } = row.status;
    if (!isNumber(then) || (row.stale && writtenAt === null)) return null;
    return then + Math.max(0, writtenAt === null ? Date.now() / 1000 - receivedAt : this.now() - writtenAt);
  }

  /** Sentences about machines that have a problem, or whose daemon does not run. */
  problems(only = null) {
    const found = [];
    for (const machine of this.machines.values()) {
      if (only && machine.name !== only) continue;
      if (machine.error) found.push({ machine: machine.name, text: machine.error });
      if (machine.running === false)
        found.push({ machine: machine.name, text: `${daemonSentence(machine.status)}. What is shown is what it said last.` });
      for (const [name, text] of Object.entries(machine.problems ?? {}))
        found.push({ machine: machine.name, text: `${name}: ${text}` });
    }
    return found;
  }

  /** The zone of a machine. */
  zone(machineName) {
    return this.machines.get(machineName)?.timezone ?? this.zones.get(machineName) ?? "UTC";
  }
}
