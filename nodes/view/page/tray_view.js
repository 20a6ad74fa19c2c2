// The tray close up: the scene with its camera, switches and labels.

import { byId, el, setAll, setText } from "./dom.js";
import { Orbit, VIEWS } from "./orbit.js";
import { Painter } from "./picture.js";
import { partPoints, partRadius } from "./part_mesh.js";
import { mix } from "./playback.js";
import { Scene } from "./scene.js";
import { SlowMotion } from "./slow_motion.js";
import { onTheme } from "./theme.js";

/** Time between pictures above which they are drawn coarser, and below which finer, ms. */
const PACE_MS = { slow: 30, fast: 19 };
/** How finely pictures are drawn, as a share of the screen's own pixels; below `parts` the parts are drawn simpler, too. */
const QUALITY = { least: 0.4, parts: 0.8, most: 1 };
/** Where there is no graphics card it begins so. */
const QUALITY_IN_SOFTWARE = 0.6;
/** A tray that is no wider is drawn as finely as the screen allows, px. */
const SMALL_PX = 420;
/** Pictures between two looks at how fast they come, or the time in which a few came, ms. */
const JUDGED = { most: 20, least: 3, withinMs: 1000 };
/** A picture that stands for so long is drawn once more, as finely as can be, ms. */
const STILL_MS = 250;
const STILL_QUALITY = 1.6;

export class TrayView {
  constructor() {
    this.canvas = byId("tray-canvas");
    this.labels = byId("tray-labels");
    this.options = { truth: true, trails: true, marks: true };
    this.servo = new SlowMotion();
    this.painter = null;
    this.times = [];
    this.size = [0, 0];
    this.isVisible = true;
    try {
      this.scene = new Scene(this.canvas);
      this.quality = this.scene.isSoftware ? QUALITY_IN_SOFTWARE : QUALITY.most;
    } catch (error) {
      this.scene = null;
      setText(byId("tray-missing"), `The tray cannot be drawn in 3D: ${error.message}. Everything else works.`);
      setAll(byId("tray-missing"), { hidden: null });
      setAll(this.canvas, { hidden: true });
    }
    /** Whether something else than time has changed what is to be drawn. */
    this.hasChanged = true;
    const changed = () => {
      this.hasChanged = true;
    };
    onTheme(changed);
    this.orbit = new Orbit(this.canvas, changed);
    for (const button of byId("tray-options").children) {
      button.addEventListener("click", () => this.toggle(button.dataset.option));
    }
    for (const button of byId("tray-views").children) {
      button.addEventListener("click", () => this.orbit.goTo(VIEWS[button.dataset.view]));
    }
    new ResizeObserver(([entry]) => {
      this.size = [entry.contentRect.width, entry.contentRect.height];
      changed();
    }).observe(this.canvas);
    new IntersectionObserver(([entry]) => {
      this.isVisible = entry.isIntersecting;
    }).observe(this.canvas);
    this.#showOptions();
  }

  /** Switches an overlay. @param {"truth" | "trails" | "marks"} option */
  toggle(option) {
    this.options[option] = !this.options[option];
    this.#showOptions();
  }

  #showOptions() {
    this.hasChanged = true;
    for (const button of byId("tray-options").children) {
      setAll(button, { "aria-pressed": String(this.options[button.dataset.option]) });
    }
    setText(byId("tray-note"), this.options.truth
      ? "every part where it truly lies, coloured by what the selector says"
      : "what the selector sees, where it takes it to be");
  }

  /** @param {any} hello @param {string} feeder name */
  look(hello, feeder) {
    const described = hello.feeders.find(({ name }) => name === feeder);
    const radius = described.footprint_radius_m ?? described.tray.outer_radius_m * 1.1;
    this.tray = described.tray;
    this.hasChanged = true;
    this.painter = new Painter(hello, feeder, partRadius(hello.part));
    this.feeder = feeder;
    this.servo.clear();
    this.scene?.setTray(described.tray, radius);
    const points = partPoints(hello.part);
    this.scene?.setParts({ fine: hello.part.poses.map(() => points), coarse: hello.part.poses.map(({ drawn }) => partPoints(drawn)) });
    this.#label();
  }

  /** Words at their places on the tray. */
  #label() {
    const { tray } = this;
    const at = (angle, z, text, r = tray.outer_radius_m + 0.012) => ({ place: [r * Math.cos(angle), r * Math.sin(angle), z], element: el("span", {}, text) });
    const half = tray.ramp_angle_rad / 2;
    this.words = [
      at(0.5, 0, "foot", 0.78 * tray.outer_radius_m), at(half, tray.rise_m / 2, "ramp ↗"),
      at(tray.ramp_angle_rad + (2 * Math.PI - tray.ramp_angle_rad) / 2, tray.rise_m, "plateau"),
      at(-0.05, tray.rise_m + 0.012, "drop-off"),
    ];
    this.labels.replaceChildren(...this.words.map(({ element }) => element));
  }

  /**
   * @param {import("./playback.js").Moment} moment @param {import("./playback.js").Playback} playback
   * @param {number} seconds since the last picture
   */
  draw(moment, playback, seconds) {
    const isMoving = this.orbit.glide(seconds);
    const now = performance.now();
    if (moment.timeS !== this.drawn?.timeS || isMoving || this.hasChanged) {
      this.stillSince = now;
      this.hasChanged = false;
      this.#pace(seconds * 1000);
      this.#paint(moment, playback, this.quality);
    } else if (now - this.stillSince > STILL_MS) {
      this.stillSince = Infinity;
      this.#paint(moment, playback, STILL_QUALITY);
    } else if (moment.newer !== this.drawn.frame) {
      // Time stands, but something else was heard.
      this.#paint(moment, playback, this.stillSince === Infinity ? STILL_QUALITY : this.quality);
    }
  }

  #paint(moment, playback, quality) {
    if (!this.painter || !moment.newer.feeders[this.feeder]) {
      return;
    }
    this.drawn = { frame: moment.newer, timeS: moment.timeS };
    const picture = this.painter.paint(moment, playback, this.options, this.#courier(moment));
    this.#count();
    if (!this.scene || !this.isVisible || this.size[0] < 2) {
      return;
    }
    // Coarser, nothing could be made out on a small tray.
    this.scene.fit(...this.size, Math.max(quality, Math.min(QUALITY.most, SMALL_PX / this.size[0])));
    this.scene.look(this.orbit.eye());
    this.scene.draw(picture, quality < QUALITY.parts);
    for (const { place, element } of this.words) {
      const at = this.scene.onScreen(place, picture.yaw);
      element.style.transform = at ? `translate(${(at[0] * this.size[0]).toFixed(1)}px, ${(at[1] * this.size[1]).toFixed(1)}px) translate(-50%, -50%)` : "scale(0)";
    }
  }

  /** Where courier and tray are: by the servo's samples where they are at hand. */
  #courier({ older, newer, share, timeS }) {
    const sampled = this.servo.at(timeS);
    if (sampled) {
      return sampled;
    }
    const now = newer.feeders[this.feeder].courier ?? { x_m: 0, y_m: 0, yaw_rad: 0 };
    const before = older.feeders[this.feeder]?.courier ?? now;
    const at = (key) => mix(before[key], now[key], share);
    return { x_m: at("x_m"), y_m: at("y_m"), yaw_rad: at("yaw_rad") };
  }

  /** How many parts there are of each kind, beside their colours. */
  #count() {
    const counts = { pick: 0, seen: 0, unsure: 0, unseen: 0 };
    for (const part of this.painter.shown) {
      counts[part.verdict] += 1;
    }
    for (const [kind, count] of Object.entries(counts)) {
      setText(byId(`count-${kind}`), String(count));
    }
  }

  /** Draws coarser where pictures come too slowly, finer again where they do not. */
  #pace(ms) {
    this.times.push(ms);
    const { length } = this.times;
    const sum = this.times.reduce((all, one) => all + one, 0);
    if (length < JUDGED.least || (length < JUDGED.most && sum < JUDGED.withinMs)) {
      return;
    }
    const middle = this.times.sort((a, b) => a - b)[Math.floor(length / 2)];
    this.times = [];
    if (middle > PACE_MS.slow) {
      this.quality = Math.max(QUALITY.least, this.quality * (middle > 2 * PACE_MS.slow ? 0.6 : 0.85));
    } else if (middle < PACE_MS.fast) {
      this.quality = Math.min(QUALITY.most, this.quality * 1.08);
    }
  }
}
