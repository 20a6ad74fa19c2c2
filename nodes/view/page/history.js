// Values over simulated time, as far back as the plots show them.

/** Simulated seconds that are kept. */
export const SPAN_S = 90;

export class History {
  /** @param {string[]} names of the values @param {number} [step] least time between two points, s */
  constructor(names, step = 0.25) {
    this.names = names;
    this.step = step;
    this.clear();
  }

  clear() {
    /** @type {number[]} */
    this.times = [];
    this.values = Object.fromEntries(this.names.map((name) => [name, /** @type {number[]} */ ([])]));
  }

  /** @param {number} time s @param {Record<string, number | null | undefined>} values */
  add(time, values) {
    const last = this.times.at(-1) ?? -Infinity;
    if (time < last) {
      this.clear();
    } else if (time - last < this.step) {
      return;
    }
    this.times.push(time);
    for (const name of this.names) {
      this.values[name].push(values[name] ?? Number.NaN);
    }
    while (this.times[0] < time - SPAN_S) {
      this.times.shift();
      this.names.forEach((name) => this.values[name].shift());
    }
  }

  /** As a plot takes it. @param {string[]} names @returns {import("./plot.js").Data} */
  data(names) {
    const to = this.times.at(-1) ?? 0;
    const from = Math.max(this.times[0] ?? 0, to - SPAN_S);
    return { x: [Math.min(from, to - 10), to], lines: names.map((name) => ({ xs: this.times, ys: this.values[name] })) };
  }
}
