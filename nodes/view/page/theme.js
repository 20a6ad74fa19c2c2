// Light and dark: as the system says until somebody chooses. Also the colours that canvases draw with.

const KEPT = "feeder-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set();
/** @type {Record<string, string>} */
let colours = {};

/** True where motion that only pleases is to be left out. */
export const isCalm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

export const isDark = () => document.documentElement.dataset.theme === "dark";

/** The value of a colour of the style sheet, by its name without dashes. @param {string} name */
export function colour(name) {
  colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  return colours[name];
}

/** A colour of the style sheet as linear light, for WebGL. @param {string} name @returns {[number, number, number]} */
export function light(name) {
  const hex = colour(name).replace("#", "");
  const channel = (at) => (Number.parseInt(hex.slice(at, at + 2), 16) / 255) ** 2.2;
  return [channel(0), channel(2), channel(4)];
}

/** A colour of the style sheet as the screen shows it, for WebGL. @param {string} name */
export const shade = (name) => light(name).map((channel) => channel ** (1 / 2.2));

/** Calls this whenever the colours have changed. @param {() => void} listener */
export const onTheme = (listener) => listeners.add(listener);

function apply(theme) {
  document.documentElement.dataset.theme = theme;
  colours = {};
  listeners.forEach((listener) => listener());
}

/** What was chosen before; a browser may refuse to keep anything. */
function kept() {
  try {
    return localStorage.getItem(KEPT);
  } catch {
    return null;
  }
}

/** Sets the theme for the first time, and follows the system from then on. */
export function startTheme() {
  const system = () => (dark.matches ? "dark" : "light");
  apply(kept() ?? system());
  dark.addEventListener("change", () => kept() ?? apply(system()));
}

export function toggleTheme() {
  const theme = isDark() ? "light" : "dark";
  try {
    localStorage.setItem(KEPT, theme);
  } catch {
    // It holds until the page is closed.
  }
  apply(theme);
}
