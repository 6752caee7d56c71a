// Requests to the server of this page.

/** What the server said instead of an answer; `status` is 0 where it said nothing, `key` names the answer it is about. */
export class ApiError extends Error {
  constructor(message, status, key = "") {
    super(message);
    this.status = status;
    this.key = key;
  }
}

const escaped = encodeURIComponent;
export const channelPath = (machine, channel) => `api/channels/${escaped(machine)}/${escaped(channel)}`;
export const machinePath = (machine) => `api/machines/${escaped(machine)}`;
export const eventPath = (id) => `api/events/${escaped(id)}`;
export const filePath = (name) => `records/${escaped(name)}`;

/** Address of a channel's view. */
export const channelHref = (machine, channel) => `#/channel/${escaped(machine)}/${escaped(channel)}`;

/** A query string of what is not missing. */
export function query(values) {
  const given = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  return given.length ? `?${new URLSearchParams(given)}` : "";
}

async function request(path, options) {
  let response;
  try {
    response = await fetch(path, { credentials: "same-origin", ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ApiError("The server does not answer.", 0);
  }
  const body = response.status === 204 ? null : await response.json().catch(() => null);
  if (!response.ok) throw new ApiError(body?.error ?? `The server answered ${response.status}.`, response.status, body?.key);
  return body;
}

export const get = (path, signal) => request(path, { signal });
export const post = (path, body) =>
  request(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body ?? {}) });
