// How it feeds, over time: the learning's error, part speeds, gaps, good parts a minute, and the figures above them.

import { byId, el, keyed, setText } from "./dom.js";
import { fixed, si, significant, UNKNOWN } from "./format.js";
import { History } from "./history.js";
import { Plot } from "./plot.js";

const median = (values) => {
  const sorted = values.filter((value) => value !== null).sort((a, b) => a - b);
  return sorted.length > 0 ? sorted[Math.floor(sorted.length / 2)] : null;
};

export class FeedView {
  constructor() {
    const time = { x: "s" };
    this.plots = {
      error: new Plot(byId("plot-error"), {
        ...time, title: "Error of velocity, each period", unit: "mrad/s rms", factor: 1e3, isLog: true, least: 1,
        empty: "Shown while the tray vibrates",
        series: [{ name: "commanded less actual", colour: "line-a" }],
      }),
      speed: new Plot(byId("plot-speed"), {
        ...time, title: "Speed of parts along the track", unit: "mm/s", factor: 1e3, floor: 0, least: 0.005,
        empty: "Known in simulation alone",
        series: [{ name: "on the ramp", colour: "line-b" }, { name: "on the plateau", colour: "line-c" }],
      }),
      gap: new Plot(byId("plot-gap"), {
        ...time, title: "Free gap to the next part on the plateau", unit: "mm", factor: 1e3, floor: 0, least: 0.005,
        empty: "No two parts on the plateau yet",
        series: [{ name: "median, as seen", colour: "line-a" }, { name: "mean, in truth", colour: "line-e", dash: [5, 4] }],
      }),
      good: new Plot(byId("plot-good"), {
        ...time, title: "Parts fed", unit: "/min", floor: 0, least: 10,
        empty: "No count yet",
        series: [{ name: "past the middle", colour: "line-e" }, { name: "could be picked", colour: "line-c", width: 2.2 }],
      }),
    };
    this.clear();
  }

  clear() {
    this.history = new History(["ramp", "plateau", "gap"]);
    this.scores = new History(["gap", "all", "good"], 0.4);
    this.error = null;
    this.unit = "yaw";
    Object.values(this.plots).forEach((plot) => plot.set(null));
    keyed(byId("figures"), [], () => "", () => el("div"), () => undefined);
  }

  /** @param {any} frame @param {string} feeder */
  addFrame(frame, feeder) {
    const state = frame.feeders[feeder];
    const gaps = state.candidates?.parts.map(({ part_gap_m: gap }) => gap) ?? [];
    this.history.add(frame.time_s, { ...state.track_speed_m_s, gap: median(gaps) });
    this.plots.speed.set(this.history.data(["ramp", "plateau"]));
    this.#setGaps();
  }

  #setGaps() {
    const seen = this.history.data(["gap"]);
    const truth = this.scores.data(["gap"]);
    this.plots.gap.set({ x: seen.x, lines: [...seen.lines, ...truth.lines] });
  }

  /** @param {any} motion */
  addMotion(motion) {
    const { time_s: times, velocity_rms: errors } = motion.errors;
    const to = times.at(-1) ?? 0;
    // The median of some, as those in which it starts and stops are far off.
    this.error = median(errors.slice(-9));
    this.unit = motion.axis;
    // Between two times at which it vibrates there is nothing to be drawn.
    const shown = errors.map((error, i) => (times[i] - times[i - 1] > 2.5 * motion.period_s ? Number.NaN : error));
    this.plots.error.set({ x: [times[0] ?? to - 1, to], lines: [{ xs: times, ys: shown }] });
  }

  /** @param {any} status @param {string} feeder @param {any} frame */
  addStatus(status, feeder, frame) {
    const { metrics, progress, counts } = status.feeders[feeder] ?? {};
    if (metrics && status.time_s !== null) {
      this.scores.add(status.time_s, {
        gap: metrics.gap_m > 0 ? metrics.gap_m : null, all: metrics.passed_per_min, good: metrics.good_per_min,
      });
      this.plots.good.set(this.scores.data(["all", "good"]));
    }
    showFigures(frame?.feeders[feeder], metrics, progress, counts, this.error, this.unit);
  }

  draw() {
    Object.values(this.plots).forEach((plot) => plot.draw());
  }
}

function showFigures(state, metrics, progress, counts, error, axis) {
  const delivery = state?.delivery;
  const seen = state?.candidates?.parts;
  const pickable = seen?.filter(({ may_be_picked: may }) => may).length;
  const figures = [
    ["Delivered", delivery ? String(delivery.delivered) : UNKNOWN, delivery ? `of ${delivery.accepted}${delivery.failed > 0 ? `, ${delivery.failed} failed` : ""}` : ""],
    ["May be picked", seen ? String(pickable) : UNKNOWN, seen ? `of ${seen.length} seen` : ""],
    ["In the tray", counts ? String(counts.parts) : UNKNOWN, "parts"],
    ["Good parts", significant(metrics?.good_per_min, 2), "/min"],
    ["Apart on the plateau", metrics ? fixed(metrics.singulation * 100, 0) : UNKNOWN, "%"],
    ["Selected wrongly", metrics ? String(metrics.wrong_selections) : UNKNOWN, metrics ? `of ${metrics.right_selections + metrics.wrong_selections}` : ""],
    ["Largest slip in delivery", ...parted(progress?.slip_m_max === null ? null : si(progress?.slip_m_max, "m"))],
    ["Error of velocity", ...parted(error === null ? null : si(error, axis === "yaw" ? "rad/s" : "m/s"))],
  ];
  const make = () => el("div", {}, el("dt"), el("dd", {}, el("span"), " ", el("small")));
  keyed(byId("figures"), figures, ([name]) => name, make, (item, [name, value, unit]) => {
    setText(item.children[0], name);
    setText(item.children[1].children[0], value);
    setText(item.children[1].children[1], unit);
  });
}

/** A value and its unit, apart. */
const parted = (text) => (text === null || text === UNKNOWN ? [UNKNOWN, ""] : text.split(" "));

