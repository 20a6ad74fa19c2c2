// Numbers for people: a fixed count of digits, a real minus, and a unit that fits the size.

const PREFIXES = [
  [1e-9, "n"],
  [1e-6, "µ"],
  [1e-3, "m"],
  [1, ""],
  [1e3, "k"],
  [1e6, "M"],
];

/** What stands where a value is not known. */
export const UNKNOWN = "–";

const isKnown = (value) => typeof value === "number" && Number.isFinite(value);

/** A number with this many significant digits, at most five places. @param {number} value */
export function significant(value, digits = 3) {
  if (!isKnown(value)) {
    return UNKNOWN;
  }
  if (value === 0) {
    return "0";
  }
  const places = Math.max(0, Math.min(5, digits - 1 - Math.floor(Math.log10(Math.abs(value)))));
  return value.toFixed(places).replace("-", "−");
}

/** A number with this many places. @param {number} value @param {number} places */
export function fixed(value, places) {
  return isKnown(value) ? value.toFixed(places).replace("-", "−") : UNKNOWN;
}

/** A value in SI with a prefix: 0.0042 m is 4.20 mm, and zero is 0 mm. @param {number} value @param {string} unit */
export function si(value, unit, digits = 3) {
  if (!isKnown(value)) {
    return UNKNOWN;
  }
  const size = Math.abs(value);
  const [factor, prefix] =
    size === 0 ? [1e-3, "m"] : (PREFIXES.findLast(([factor]) => size >= factor * 0.9995) ?? PREFIXES[0]);
  return `${significant(value / factor, digits)} ${prefix}${unit}`;
}

/** @param {number} value m */
export const millimetres = (value, places = 1) => (isKnown(value) ? `${fixed(value * 1e3, places)} mm` : UNKNOWN);

/** @param {number} value rad */
export const degrees = (value, places = 1) => `${fixed((value * 180) / Math.PI, places)}°`;

/** Bytes. */
export const bytes = (value) => si(value, "B");

/** A time since the start: 75.24 is 1:15.2. @param {number} seconds */
export function clock(seconds, places = 1) {
  if (!isKnown(seconds)) {
    return UNKNOWN;
  }
  const rounded = Number(seconds.toFixed(places));
  const minutes = Math.floor(rounded / 60);
  const rest = (rounded - minutes * 60).toFixed(places).padStart(places ? places + 3 : 2, "0");
  return minutes < 60 ? `${minutes}:${rest}` : `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${rest}`;
}
