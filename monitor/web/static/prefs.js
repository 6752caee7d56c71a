// Choices of the reader: kept in the browser, passed to the views.

const listeners = new Set();

function stored(key) {
  try {
    return localStorage.getItem(`spallwatch.${key}`);
  } catch {
    return null;
  }
}

export const prefs = { theme: stored("theme") ?? "auto", zone: stored("zone") ?? "machine" };

/** Keep a choice and tell the listeners. */
export function choose(key, value) {
  prefs[key] = value;
  try {
    localStorage.setItem(`spallwatch.${key}`, value);
  } catch {
    // A browser that keeps nothing forgets the choice with the page.
  }
  applyTheme();
  for (const listener of listeners) listener(key);
}

/** Subscribe to changes; returns the function that ends it. */
export function onPrefs(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Say to the style sheet which theme was chosen; "auto" leaves it to the system. */
export function applyTheme() {
  if (prefs.theme === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = prefs.theme;
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const listener of listeners) listener("theme");
});

/** A colour of the style sheet by its name, as it is now. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
