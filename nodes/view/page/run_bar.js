// The bar at the top: time and pace of the run, pause and step, speed, emergency stop.

import { byId, el, setAll, setText } from "./dom.js";
import { clock, fixed } from "./format.js";

/** Speeds to choose from; slow ones show what happens within a period. Null is as fast as possible. */
const SPEEDS = [[0.01, "1/100"], [0.05, "1/20"], [0.25, "1/4"], [1, "1×"], [5, "5×"], [null, "max"]];
const STEP_TICKS = 1;

/** How fast time passes, with as many places as say something, and always as many at about one. */
const factor = (value) => fixed(value, value < 0.095 ? 3 : value < 9.95 ? 2 : 0);

export class RunBar {
  /** @param {import("./permissions.js").Permissions} permissions @param {(name: string, feeder: string | null, values?: any) => any} control */
  constructor(permissions, control) {
    this.isPaused = false;
    this.focus = null;
    this.control = control;
    this.permissions = permissions;
    const choice = byId("speeds");
    this.speeds = SPEEDS.map(([speed, label]) => {
      const button = el("button", { type: "button", "aria-pressed": "false", title: speed === null ? "As fast as possible" : `Simulated seconds per second: ${label}` }, label);
      permissions.bind(button, speed === null ? "full_speed" : "speed", () => (speed === null ? control("full_speed", null) : control("speed", null, { speed })));
      return { button, speed };
    });
    choice.replaceChildren(...this.speeds.map(({ button }) => button));
    permissions.bind(byId("pause"), "pause", () => this.togglePause());
    permissions.bind(byId("step"), "step", () => this.step(), () => (this.isPaused ? null : "pause first"));
    permissions.bind(byId("reset"), "reset", () => control("reset", null));
    permissions.bind(byId("stop"), "emergency_stop", () => this.stop());
  }

  togglePause() {
    return this.control(this.isPaused ? "resume" : "pause", null);
  }

  step() {
    return this.isPaused ? this.control("step", null, { ticks: STEP_TICKS }) : null;
  }

  stop() {
    return this.control("emergency_stop", this.focus);
  }

  /** The next slower or faster speed. @param {1 | -1} by */
  shift(by) {
    const now = this.speeds.findIndex(({ button }) => button.getAttribute("aria-pressed") === "true");
    const next = this.speeds[Math.min(this.speeds.length - 1, Math.max(0, (now < 0 ? 3 : now) + by))];
    next.button.click();
  }

  /** @param {any} frame @param {number | null} timeS what is shown now */
  show(frame, timeS) {
    setText(byId("time"), clock(timeS ?? Number.NaN, 2));
    const pace = frame.paused ? "paused" : frame.ended ? "ended" : `${factor(frame.real_time_factor)} × real time`;
    setText(byId("pace"), pace);
    if (frame.paused !== this.isPaused) {
      this.isPaused = frame.paused;
      const words = frame.paused ? "Go on" : "Pause";
      setAll(byId("pause"), { "aria-label": words, title: words, "data-paused": String(frame.paused) });
      this.permissions.refresh();
    }
    for (const { button, speed } of this.speeds) {
      const isNow = speed === null ? frame.speed === null : frame.speed !== null && Math.abs(frame.speed / speed - 1) < 0.01;
      setAll(button, { "aria-pressed": String(isNow) });
    }
  }
}
