// What the feeders did of late: the phases of their deliveries as a band each, and the events as a list.

import { byId, el, keyed, setAll, setText } from "./dom.js";
import { clock } from "./format.js";
import { colour, onTheme } from "./theme.js";

/** Simulated seconds that the bands show. */
const SPAN_S = 40;
/** Events that are kept, and those that are listed. */
const KEPT = 500;
const LISTED = 40;
/** No run lasts so long: a later time is one of the wall clock, s. */
const WALL_S = 1e9;
const BAND_PX = 26;
const AXIS_PX = 20;
const LABEL_PX = 74;

const PHASES = {
  idle: "phase-idle", feeding: "phase-feed", purging: "phase-feed", stopping: "phase-settle", settling: "phase-settle",
  looking: "phase-look", reserving: "phase-idle", moving: "phase-move", presented: "phase-present",
  returning: "phase-move", fault: "phase-fault",
};
const SIGNS = { delivered: "✓", failed: "✕", fault: "✕", missed: "✕", warning: "▲", goal: "◆", picked: "▼", run: "▶", control: "◇" };
const LEVEL_SIGNS = { info: "·", warn: "▲", error: "✕" };

export class Timeline {
  /** @param {any} hello */
  constructor(hello) {
    this.names = hello.feeders.map(({ name }) => name);
    this.canvas = byId("timeline");
    this.canvas.style.height = `${this.names.length * (BAND_PX + 6) + AXIS_PX}px`;
    this.clear();
    new ResizeObserver(([entry]) => {
      this.width = entry.contentRect.width;
    }).observe(this.canvas);
    onTheme(() => this.draw(this.now));
  }

  clear() {
    this.events = [];
    /** @type {Map<string, {from: number, phase: string, delivery: string}[]>} */
    this.phases = new Map(this.names.map((name) => [name, []]));
    this.skipped = 0;
    this.hasChanged = true;
    this.width ??= 0;
    this.now = 0;
  }

  /** @param {{skipped: number, events: any[]}} message */
  add(message) {
    this.skipped += message.skipped;
    for (const event of message.events) {
      if (event.kind === "run" && event.time_s !== null && event.time_s < this.now) {
        this.clear();
      }
      this.events.push(event);
      const band = this.phases.get(event.feeder);
      if (band && (event.kind === "phase" || event.kind === "presented")) {
        band.push({ from: event.time_s, phase: event.message, delivery: event.delivery_id ?? "" });
      }
    }
    this.events.splice(0, this.events.length - KEPT);
    this.hasChanged = true;
  }

  /** @param {number} now simulated time, s @param {any} [frame] tells the phases of whoever was there before the page */
  draw(now, frame) {
    this.now = now;
    for (const [name, band] of this.phases) {
      const delivery = frame?.feeders[name]?.delivery;
      if (band.length === 0 && delivery) {
        band.push({ from: now, phase: delivery.phase, delivery: delivery.delivery_id ?? "" });
      }
      while (band.length > 1 && band[1].from < now - SPAN_S) {
        band.shift();
      }
    }
    this.#drawBands(now);
    if (this.hasChanged) {
      this.hasChanged = false;
      this.#list();
    }
  }

  #drawBands(now) {
    const { canvas, width } = this;
    const height = this.names.length * (BAND_PX + 6) + AXIS_PX;
    if (width < 80) {
      return;
    }
    const scale = Math.min(2, devicePixelRatio || 1);
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
    }
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "11px ui-sans-serif, system-ui, sans-serif";
    context.textBaseline = "middle";
    const from = Math.max(0, now - SPAN_S);
    const x = (time) => LABEL_PX + ((time - from) / SPAN_S) * (width - LABEL_PX - 4);
    this.names.forEach((name, row) => this.#drawBand(context, name, row * (BAND_PX + 6), x, now));
    context.fillStyle = colour("soft");
    context.textAlign = "center";
    for (let tick = Math.ceil(from / 10) * 10; tick <= from + SPAN_S; tick += 10) {
      if (x(tick) < width - 16) {
        context.fillText(clock(tick, 0), x(tick), height - 8);
      }
    }
  }

  #drawBand(context, name, top, x, now) {
    const band = this.phases.get(name);
    context.fillStyle = colour("soft");
    context.textAlign = "left";
    context.fillText(name, 0, top + BAND_PX / 2, LABEL_PX - 8);
    band.forEach(({ from, phase }, index) => {
      const left = Math.max(LABEL_PX, x(from));
      const right = x(band[index + 1]?.from ?? now);
      context.fillStyle = colour(PHASES[phase] ?? "phase-idle");
      context.fillRect(left, top, Math.max(0, right - left - 1), BAND_PX);
      if (right - left > 8 + phase.length * 6) {
        context.fillStyle = colour("on-phase");
        context.fillText(phase, left + 5, top + BAND_PX / 2 + 0.5);
      }
    });
    context.textAlign = "center";
    for (const event of this.events) {
      if (event.feeder === name && (event.kind === "delivered" || event.kind === "failed" || event.kind === "fault") && x(event.time_s) > LABEL_PX) {
        context.fillStyle = colour(event.kind === "delivered" ? "good" : "bad");
        context.beginPath();
        context.arc(x(event.time_s), top + 3, 7, 0, 7);
        context.fill();
        context.fillStyle = colour("panel");
        context.fillText(SIGNS[event.kind], x(event.time_s), top + 3.5);
      }
    }
  }

  #list() {
    const shown = this.events.filter(({ kind }) => kind !== "phase" && kind !== "presented").slice(-LISTED).reverse();
    const make = () => el("li", {}, el("time"), el("i", { "aria-hidden": "true" }), el("b"), el("span"));
    keyed(byId("events"), shown, ({ sequence }) => String(sequence), make, (item, event) => {
      const [time, sign, what, text] = item.children;
      setAll(item, { class: event.level });
      setText(time, timeOf(event));
      setText(sign, SIGNS[event.kind] ?? LEVEL_SIGNS[event.level] ?? "·");
      setText(what, [event.node ?? (this.names.length > 1 ? event.feeder : null), event.kind === "log" ? "" : event.kind.replaceAll("_", " ")].filter(Boolean).join(" "));
      setText(text, [event.message, event.station && `at ${event.station}`, event.delivery_id].filter(Boolean).join(" · "));
    });
    setText(byId("events-note"), this.skipped > 0 ? `${this.skipped} events came too fast and are not shown` : "");
  }
}

/** Simulated time; what was said before that began bears the time of day. */
function timeOf({ time_s: time }) {
  if (time === null) {
    return "";
  }
  return time > WALL_S ? new Date(time * 1000).toLocaleTimeString([], { hour12: false }) : clock(time, 1);
}
