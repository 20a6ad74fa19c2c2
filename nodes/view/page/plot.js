// A plot on a canvas: lines over a common axis, shaded bands, level lines, and the values under the pointer.

import { el, setText } from "./dom.js";
import { significant, UNKNOWN } from "./format.js";
import { colour, onTheme } from "./theme.js";

/**
 * @typedef {{name: string, colour: string, unit?: string, width?: number, dash?: number[], steps?: boolean}} Series
 * @typedef {{from: number, to: number, colour: string}} Band
 * @typedef {{at: number, label: string}} Level
 * @typedef {{x: [number, number], lines: {xs: ArrayLike<number>, ys: ArrayLike<number>}[], bands?: Band[], levels?: Level[]}} Data
 */

const MARGIN = { left: 46, right: 10, top: 8, bottom: 22 };
const FONT = "11px ui-sans-serif, system-ui, sans-serif";

/** Steps of 1, 2 or 5 times a power of ten that part a range into about `count`. */
export function ticks(low, high, count) {
  const rough = (high - low) / Math.max(1, count);
  if (!(rough > 0) || !Number.isFinite(rough)) {
    return [];
  }
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((factor) => factor * power >= rough) * power;
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

export class Plot {
  /**
   * @param {HTMLElement} host
   * @param {{title: string, unit: string, x: string, series: Series[], floor?: number, symmetric?: boolean, least?: number,
   *   empty?: string, factor?: number, xFactor?: number, isLog?: boolean}} spec
   *   `floor` is a lowest value that is always shown, `least` a span below which the range does not shrink, `factor`
   *   what values are multiplied by to have the unit. On a logarithmic axis spans are in decades.
   */
  constructor(host, spec) {
    this.spec = { least: 0, factor: 1, xFactor: 1, empty: "No data yet", ...spec };
    this.canvas = el("canvas", { role: "img", "aria-label": `${spec.title}, ${spec.unit}` });
    this.values = spec.series.map(() => el("output", {}, UNKNOWN));
    const legend = el("ul", { class: "legend" }, ...spec.series.map((series, index) =>
      el("li", {}, swatch(series), el("span", {}, series.name), this.values[index])));
    const caption = el("figcaption", {}, el("b", {}, spec.title), el("span", { class: "unit" }, spec.unit));
    host.append(caption, legend, el("div", { class: "plot" }, this.canvas));
    host.classList.add("figure");
    /** @type {Data | null} */
    this.data = null;
    this.range = null;
    this.cursor = null;
    this.isDirty = true;
    this.isVisible = true;
    this.size = [0, 0];
    new ResizeObserver(([entry]) => {
      this.size = [entry.contentRect.width, entry.contentRect.height];
      this.isDirty = true;
    }).observe(this.canvas);
    new IntersectionObserver(([entry]) => {
      this.isVisible = entry.isIntersecting;
    }).observe(this.canvas);
    this.canvas.addEventListener("pointermove", (event) => this.#point(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => this.#point(null));
    onTheme(() => {
      this.isDirty = true;
    });
  }

  #point(x) {
    this.cursor = x;
    this.isDirty = true;
  }

  /** @param {Data | null} data null where there is none */
  set(data) {
    this.data = data;
    this.isDirty = true;
  }

  /** Draws what has changed, if it can be seen. */
  draw() {
    const [width, height] = this.size;
    if (!this.isDirty || !this.isVisible || width < 60 || height < 40) {
      return;
    }
    this.isDirty = false;
    const scale = Math.min(2, devicePixelRatio || 1);
    const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = FONT;
    const hasData = this.data?.lines.some((line) => line.xs.length > 0);
    if (!hasData) {
      context.fillStyle = colour("faint");
      context.textAlign = "center";
      context.fillText(this.spec.empty, width / 2, height / 2);
      this.values.forEach((value) => setText(value, UNKNOWN));
      return;
    }
    this.#drawData(context, width, height);
  }

  #drawData(context, width, height) {
    const { data, spec } = this;
    const [low, high] = this.#fitRange();
    const [from, to] = data.x;
    const area = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
    const x = (value) => area.left + ((value - from) / (to - from || 1)) * (area.right - area.left);
    const y = (value) => area.bottom - ((this.#scaled(value) - low) / (high - low || 1)) * (area.bottom - area.top);
    for (const band of data.bands ?? []) {
      context.fillStyle = colour(band.colour);
      context.fillRect(x(band.from), area.top, x(band.to) - x(band.from), area.bottom - area.top);
    }
    this.#drawAxes(context, area, x, y, [low, high]);
    context.save();
    context.beginPath();
    context.rect(area.left, area.top - 1, area.right - area.left, area.bottom - area.top + 2);
    context.clip();
    context.lineJoin = "round";
    data.lines.forEach((line, index) => drawLine(context, line, spec.series[index], x, y));
    context.restore();
    this.#drawLevels(context, area, y, [low, high]);
    this.#read(context, area, from, to, y);
  }

  /** A value as its axis counts it; what a logarithmic one cannot show is no number. */
  #scaled(value) {
    return this.spec.isLog ? (value > 0 ? Math.log10(value) : Number.NaN) : value;
  }

  /** The range of the values, with some air; it grows at once and shrinks slowly, so that the picture is calm. */
  #fitRange() {
    const { spec, data } = this;
    let [low, high] = [spec.floor ?? Infinity, spec.floor ?? -Infinity];
    for (const { ys } of data.lines) {
      for (let i = 0; i < ys.length; i += 1) {
        const value = this.#scaled(ys[i]);
        if (Number.isFinite(value)) {
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
      }
    }
    if (!Number.isFinite(low)) {
      [low, high] = [0, 1];
    }
    const missing = spec.least - (high - low);
    if (missing > 0) {
      high += spec.floor === undefined ? missing / 2 : missing;
      low -= spec.floor === undefined ? missing / 2 : 0;
    }
    if (spec.symmetric) {
      high = Math.max(-low, high);
      low = -high;
    }
    const air = (high - low || 1) * 0.08;
    const wanted = [low === spec.floor ? low : low - air, high + air];
    const old = this.range ?? wanted;
    const ease = (was, is, isInside) => (isInside ? was + (is - was) * 0.04 : is);
    this.range = [ease(old[0], wanted[0], wanted[0] > old[0]), ease(old[1], wanted[1], wanted[1] < old[1])];
    return this.range;
  }

  #drawAxes(context, area, x, y, [low, high]) {
    const { factor, xFactor, isLog } = this.spec;
    context.strokeStyle = colour("grid");
    context.fillStyle = colour("soft");
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    const marks = isLog
      ? ticks(Math.floor(low), Math.ceil(high), high - low + 2).map((power) => 10 ** power * factor)
      : ticks(low * factor, high * factor, (area.bottom - area.top) / 34);
    for (const tick of marks) {
      const at = Math.round(y(tick / factor)) + 0.5;
      if (at < area.top || at > area.bottom + 1) {
        continue;
      }
      line(context, area.left, at, area.right, at);
      context.fillText(label(tick), area.left - 6, at);
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    const [from, to] = this.data.x;
    for (const tick of ticks(from * xFactor, to * xFactor, (area.right - area.left) / 70)) {
      const at = Math.round(x(tick / xFactor)) + 0.5;
      if (at < area.right - 30) {
        context.fillText(label(tick), at, area.bottom + 6);
      }
      line(context, at, area.bottom, at, area.bottom + 3);
    }
    context.textAlign = "right";
    context.fillText(this.spec.x, area.right, area.bottom + 6);
    context.strokeStyle = colour("axis");
    line(context, area.left, area.bottom + 0.5, area.right, area.bottom + 0.5);
  }

  #drawLevels(context, area, y, [low, high]) {
    context.textAlign = "right";
    context.textBaseline = "bottom";
    for (const level of this.data.levels ?? []) {
      if (level.at > low && level.at < high) {
        const at = Math.round(y(level.at)) + 0.5;
        context.strokeStyle = colour("soft");
        context.setLineDash([2, 4]);
        line(context, area.left, at, area.right, at);
        context.setLineDash([]);
        context.fillStyle = colour("soft");
        context.fillText(level.label, area.right - 2, at - 1);
      }
    }
  }

  /** Writes the latest values beside the names, or those under the pointer. */
  #read(context, area, from, to, y) {
    const { data, spec } = this;
    const isInside = this.cursor !== null && this.cursor >= area.left && this.cursor <= area.right;
    const wanted = isInside ? from + ((this.cursor - area.left) / (area.right - area.left)) * (to - from) : to;
    if (isInside) {
      context.strokeStyle = colour("axis");
      line(context, Math.round(this.cursor) + 0.5, area.top, Math.round(this.cursor) + 0.5, area.bottom);
    }
    data.lines.forEach(({ xs, ys }, index) => {
      const at = nearest(xs, wanted);
      const value = at < 0 ? Number.NaN : ys[at] * spec.factor;
      const unit = spec.series[index].unit ?? spec.unit;
      setText(this.values[index], Number.isFinite(value) ? `${significant(value)} ${unit}` : UNKNOWN);
      if (isInside && Number.isFinite(value)) {
        context.fillStyle = colour(spec.series[index].colour);
        context.beginPath();
        context.arc(this.cursor, y(ys[at]), 3, 0, 7);
        context.fill();
      }
    });
  }
}

function swatch(series) {
  return el("i", { class: `swatch ${series.dash ? "dashed" : ""} c-${series.colour}`, "aria-hidden": "true" });
}

const label = (tick) => String(Number(tick.toPrecision(6))).replace("-", "−");

function line(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}

function drawLine(context, { xs, ys }, series, x, y) {
  context.strokeStyle = colour(series.colour);
  context.lineWidth = series.width ?? 1.6;
  context.setLineDash(series.dash ?? []);
  context.beginPath();
  let isDrawing = false;
  for (let i = 0; i < xs.length; i += 1) {
    if (!Number.isFinite(ys[i])) {
      isDrawing = false;
    } else if (!isDrawing) {
      context.moveTo(x(xs[i]), y(ys[i]));
      isDrawing = true;
    } else {
      if (series.steps) {
        context.lineTo(x(xs[i]), y(ys[i - 1]));
      }
      context.lineTo(x(xs[i]), y(ys[i]));
    }
  }
  context.stroke();
  context.setLineDash([]);
}

/** Index of the last of the rising `xs` that is not above `wanted`, or the first; -1 where there is none. */
function nearest(xs, wanted) {
  let [low, high] = [0, xs.length - 1];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (xs[middle] <= wanted) {
      low = middle;
    } else {
      high = middle - 1;
    }
  }
  return xs.length === 0 ? -1 : low;
}
