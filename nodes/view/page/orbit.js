// A camera that goes round what it looks at, by mouse, touch, wheel and keys. It glides to where it is sent.

import { isCalm } from "./theme.js";

const LIMITS = { elevation: [0.06, 1.565], distance: [0.16, 1.2] };
/** Radians for each pixel of a drag. */
const DRAG_RAD_PX = 0.0065;
/** Share of the way that is left after a second of gliding. */
const LEFT_AFTER_S = 2e-5;

/** Views that buttons and keys send to. */
export const VIEWS = {
  slanted: { azimuth: -1.05, elevation: 0.72, distance: 0.35 },
  above: { azimuth: -Math.PI / 2, elevation: 1.565, distance: 0.42 },
  side: { azimuth: 0.55, elevation: 0.2, distance: 0.36 },
};

const clamp = (value, [low, high]) => Math.min(high, Math.max(low, value));

export class Orbit {
  /** @param {HTMLElement} surface which is dragged @param {() => void} moved called when the view has to be drawn anew */
  constructor(surface, moved) {
    this.at = { ...VIEWS.slanted };
    this.goal = { ...VIEWS.slanted };
    this.moved = moved;
    this.pointers = new Map();
    surface.addEventListener("pointerdown", (event) => this.#down(surface, event));
    surface.addEventListener("pointermove", (event) => this.#move(event));
    for (const end of ["pointerup", "pointercancel"]) {
      surface.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    surface.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    surface.addEventListener("keydown", (event) => this.#key(event));
    surface.addEventListener("dblclick", () => this.goTo(VIEWS.slanted));
  }

  /** @param {{azimuth: number, elevation: number, distance: number}} view */
  goTo(view) {
    // The short way round.
    const turns = Math.round((this.at.azimuth - view.azimuth) / (2 * Math.PI));
    this.goal = { ...view, azimuth: view.azimuth + turns * 2 * Math.PI };
    this.moved();
  }

  /** Turns and zooms; at once, where `isDirect`. */
  #change({ azimuth = 0, elevation = 0, zoom = 1 }, isDirect) {
    this.goal.azimuth += azimuth;
    this.goal.elevation = clamp(this.goal.elevation + elevation, LIMITS.elevation);
    this.goal.distance = clamp(this.goal.distance * zoom, LIMITS.distance);
    if (isDirect) {
      this.at = { ...this.goal };
    }
    this.moved();
  }

  #down(surface, event) {
    surface.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) {
      return;
    }
    const spread = () => {
      const [a, b] = [...this.pointers.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const now = [event.clientX, event.clientY];
    if (this.pointers.size === 2) {
      const old = spread();
      this.pointers.set(event.pointerId, now);
      this.#change({ zoom: old / Math.max(1, spread()) }, true);
    } else {
      this.pointers.set(event.pointerId, now);
      this.#change({ azimuth: -(now[0] - before[0]) * DRAG_RAD_PX, elevation: (now[1] - before[1]) * DRAG_RAD_PX }, true);
    }
  }

  #wheel(event) {
    // With no key held the wheel scrolls the page, unless the view has the focus.
    if (event.ctrlKey || event.metaKey || document.activeElement === event.currentTarget) {
      event.preventDefault();
      this.#change({ zoom: Math.exp(clamp(event.deltaY, [-120, 120]) * 0.0022) }, false);
    }
  }

  #key(event) {
    const change = {
      ArrowLeft: { azimuth: -0.16 },
      ArrowRight: { azimuth: 0.16 },
      ArrowUp: { elevation: 0.1 },
      ArrowDown: { elevation: -0.1 },
      "+": { zoom: 0.88 },
      "=": { zoom: 0.88 },
      "-": { zoom: 1.136 },
    }[event.key];
    if (change && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      event.stopPropagation();
      this.#change(change, false);
    }
  }

  /** Goes on towards the goal. @param {number} seconds since the last time @returns {boolean} whether it still moves */
  glide(seconds) {
    const share = isCalm() ? 1 : 1 - LEFT_AFTER_S ** Math.min(seconds, 0.1);
    let rest = 0;
    for (const key of ["azimuth", "elevation", "distance"]) {
      const left = this.goal[key] - this.at[key];
      this.at[key] = Math.abs(left) < 1e-4 ? this.goal[key] : this.at[key] + left * share;
      rest += Math.abs(this.goal[key] - this.at[key]);
    }
    return rest > 0;
  }

  /** Where the eye is, seen from what it looks at, m. @returns {[number, number, number]} */
  eye() {
    const { azimuth, elevation, distance } = this.at;
    const flat = distance * Math.cos(elevation);
    return [flat * Math.cos(azimuth), flat * Math.sin(azimuth), distance * Math.sin(elevation)];
  }
}
