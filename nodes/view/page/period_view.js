// One period of the tray's motion, as the paper draws it: commanded and actual, and what a part does under it.

import { byId, el, setAll, setText } from "./dom.js";
import { degrees, fixed, millimetres } from "./format.js";
import { Plot } from "./plot.js";
import { partOver, SLIPS_BACK, SLIPS_ON, STICKS, stretches } from "./stick_slip.js";

const G_M_S2 = 9.81;
/** Steps of the theory for each sample of the tray's motion, so that its phases end where they should. */
const FINE = 4;
/** Periods in which the vibration may be ending. */
const ENDING = 4;

/** A plot on the page, and the same in the help. @param {string} id @param {any} spec */
function twice(id, spec) {
  const plots = [id, `help-${id}`].map((place) => new Plot(byId(place), spec));
  return {
    set: (data) => plots.forEach((plot) => plot.set(data)),
    draw: () => plots.forEach((plot) => plot.draw()),
  };
}

export class PeriodView {
  /** @param {any} hello */
  constructor(hello) {
    this.part = hello.part;
    this.motion = null;
    this.periods = [];
    this.measured = null;
    this.surface = "plateau";
    this.accelerations = twice("plot-acceleration", {
      title: "Acceleration of the tray along the track", unit: "m/s²", x: "ms", xFactor: 1e3, least: 1, symmetric: true,
      empty: "The tray does not vibrate",
      series: [
        { name: "commanded", colour: "line-e", dash: [5, 4], steps: true },
        { name: "actual", colour: "line-a", width: 1.8 },
      ],
    });
    this.velocities = twice("plot-velocity", {
      title: "Velocity along the track", unit: "mm/s", factor: 1e3, x: "ms", xFactor: 1e3, least: 0.01,
      empty: "The tray does not vibrate",
      series: [
        { name: "tray, commanded", colour: "line-e", dash: [5, 4] },
        { name: "tray, actual", colour: "line-a", width: 1.8 },
        { name: "part, by theory", colour: "line-b", width: 2 },
      ],
    });
    this.radius = byId("period-radius");
    this.radiusValue = byId("period-radius-value");
    this.words = byId("period-words");
    this.choices = [...byId("period-surface").children];
    // Assigned, not added: the page's elements outlive this view.
    this.radius.oninput = () => this.#update();
    for (const button of this.choices) {
      button.onclick = () => {
        this.surface = button.dataset.surface;
        this.choices.forEach((other) => setAll(other, { "aria-pressed": other === button }));
        this.#update();
      };
    }
  }

  /** @param {any} feeder of the hello */
  look(feeder) {
    this.feeder = feeder;
    const [low, high] = [feeder.tray.inner_radius_m, feeder.tray.outer_radius_m].map((radius) => Math.round(radius * 1e3));
    setAll(this.radius, { min: low + 2, max: high - 2 });
    this.radius.value = String(high - 5);
    this.motion = null;
    this.periods = [];
    this.measured = null;
    this.#update();
  }

  /**
   * @param {any} motion message; while the tray stands, the last period in which it vibrated stays
   * @param {boolean} feeding whether feeding is on: once it is off, the vibration fades
   */
  show(motion, feeding) {
    const isVibrating = feeding && motion.commanded_velocity !== null && motion.actual_acceleration.length > 0;
    this.stands = !isVibrating;
    if (isVibrating) {
      this.periods.push(motion);
      this.periods.splice(0, this.periods.length - ENDING);
    }
    // The last ones show how it comes to rest, not how it feeds.
    this.motion = (isVibrating ? motion : this.periods[0]) ?? motion;
    this.#update();
  }

  /** Takes the mean true speeds of the parts while the tray vibrates. @param {any} state of a feeder in a frame */
  measure(state) {
    if (state.courier_state?.vibrating) {
      this.measured = state.track_speed_m_s;
    }
  }

  #update() {
    const { motion } = this;
    const isOnTrack = motion?.axis === "yaw";
    const lever = isOnTrack ? Number(this.radius.value) / 1e3 : 1;
    setText(this.radiusValue, `${this.radius.value} mm`);
    if (!motion?.commanded_velocity) {
      this.accelerations.set(null);
      this.velocities.set(null);
      setText(this.words, "");
      return;
    }
    const { period_s: period, sample_period_s: step } = motion;
    const first = longestRun(motion.commanded_acceleration);
    const scaled = (values) => Float64Array.from(values, (_, i) => values[(i + first) % values.length] * lever);
    const times = Float64Array.from(motion.actual_acceleration, (_, i) => i * step);
    const [acceleration, velocity] = [scaled(motion.actual_acceleration), scaled(motion.actual_velocity)];
    const { tray } = this.feeder;
    const slope = this.surface === "ramp" && isOnTrack ? Math.atan(tray.rise_m / tray.ramp_angle_rad / lever) : 0;
    const fine = Float64Array.from({ length: acceleration.length * FINE }, (_, i) => acceleration[Math.floor(i / FINE)]);
    const { phases, slip, mean } = partOver(fine, step / FINE, this.part, slope);
    const bands = stretches(phases, step / FINE).map(({ from, to, phase }) =>
      ({ from, to, colour: phase === SLIPS_ON ? "shade-slip" : "shade-back" }));
    const x = /** @type {[number, number]} */ ([0, period]);
    const hold = this.part.friction_static * G_M_S2;
    const grip = Math.atan(this.part.friction_static);
    const levels = [
      { at: G_M_S2 * Math.tan(grip - slope), label: "sticks below" },
      { at: -G_M_S2 * Math.tan(grip + slope), label: "sticks above" },
    ];
    this.accelerations.set({ x, bands, levels: hold > 0 ? levels : [], lines: [
      { xs: times, ys: scaled(motion.commanded_acceleration) }, { xs: times, ys: acceleration },
    ] });
    const part = velocity.map((value, i) => value * Math.cos(slope) + slip[i * FINE]);
    this.velocities.set({ x, bands, lines: [
      { xs: times, ys: scaled(motion.commanded_velocity) }, { xs: times, ys: velocity }, { xs: times, ys: part },
    ] });
    this.#say(phases, mean, slope);
  }

  #say(phases, mean, slope) {
    const share = (wanted) => `${fixed((100 * phases.filter((phase) => phase === wanted).length) / phases.length, 0)} %`;
    const measured = this.measured?.[this.surface];
    const feeds = `${millimetres(mean)}/s`;
    const seen = measured === null || measured === undefined ? "" : `, and the ${this.part.name}s there go ${millimetres(measured)}/s on average, at all radii`;
    const where = slope > 0 ? `on the ramp, which rises ${degrees(slope)} there,` : "on the plateau";
    const when = this.stands ? "The tray does not vibrate now; this is the last period in which it did. " : "";
    setText(this.words, `${when}A part at ${this.radius.value} mm ${where} sticks for ${share(STICKS)} of this period, slips on for ${share(SLIPS_ON)} and back for ${share(SLIPS_BACK)}. It should feed ${feeds}${seen}.`);
  }

  draw() {
    this.accelerations.draw();
    this.velocities.draw();
  }
}

/**
 * Where the longest stretch of the same value begins, the values being those of a period. The picture of a period begins
 * there, whenever it was taken.
 */
function longestRun(values) {
  const count = values.length;
  const peak = values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  const isSame = (i) => Math.abs(values[i % count] - values[(i + count - 1) % count]) < 1e-3 * peak;
  let [best, length] = [0, 0];
  for (let start = 0; start < count; start += 1) {
    let end = start + 1;
    while (!isSame(start) && end < start + count && isSame(end)) {
      end += 1;
    }
    if (end - start > length) {
      [best, length] = [start, end - start];
    }
  }
  return best;
}
