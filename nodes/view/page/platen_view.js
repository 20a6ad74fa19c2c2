// The platen from above: couriers with their trays, stations and tools, leased areas, planned trips.
//
// Lengths are drawn in millimetres; y points up.

import { byId, el, keyed, setAll, setText, svg } from "./dom.js";
import { mix } from "./playback.js";

const MM = 1000;
/** Radius of the mark of a station, mm. */
const STATION_MM = 9;
const GRID_MM = 100;

export class PlatenView {
  /** @param {any} hello @param {(feeder: string) => void} choose called when a courier is clicked */
  constructor(hello, choose) {
    this.hello = hello;
    const { x_m_min, x_m_max, y_m_min, y_m_max } = hello.platen;
    this.box = [x_m_min * MM, -y_m_max * MM, (x_m_max - x_m_min) * MM, (y_m_max - y_m_min) * MM];
    /** Words and marks grow with the platen, so that they can be read on a large one. */
    this.scale = Math.max(1, this.box[2] / 520, this.box[3] / 330);
    this.areas = svg("g");
    this.trips = svg("g");
    this.couriers = svg("g");
    this.stations = svg("g");
    this.drawing = svg("svg", {
      viewBox: this.box.join(" "), class: "platen", role: "img", "aria-label": "The platen from above",
    }, this.#grid(), this.#keepOut(), this.areas, this.trips, this.couriers, this.stations);
    this.drawing.style.setProperty("--scale", String(this.scale));
    this.feeders = hello.feeders.map((feeder) => this.#courier(feeder, choose));
    this.tools = hello.stations.map((station) => this.#station(station));
    this.status = el("ul", { class: "waits" });
    byId("platen-body").replaceChildren(this.drawing, this.status);
  }

  #grid() {
    const [left, top, width, height] = this.box;
    const lines = [];
    const steps = (from, to) => {
      const first = Math.ceil(from / GRID_MM);
      return Array.from({ length: Math.max(0, Math.floor(to / GRID_MM) - first + 1) }, (_, i) => (first + i) * GRID_MM);
    };
    for (const x of steps(left, left + width)) {
      lines.push(svg("line", { x1: x, x2: x, y1: top, y2: top + height, class: x === 0 ? "zero" : "grid" }));
    }
    for (const y of steps(top, top + height)) {
      lines.push(svg("line", { x1: left, x2: left + width, y1: y, y2: y, class: y === 0 ? "zero" : "grid" }));
    }
    // A length to measure with.
    const [x, y] = [left + 12 * this.scale, top + 22 * this.scale];
    const scale = svg("g", { class: "scale" },
      svg("path", { d: `M${x} ${y - 4}v4h${GRID_MM}v-4` }),
      svg("text", { x: x + GRID_MM / 2, y: y - 7 * this.scale }, "100 mm"));
    return svg("g", {}, ...lines, scale);
  }

  #keepOut() {
    const all = this.hello.feeders.flatMap((feeder) => feeder.keep_out);
    return svg("g", {}, ...all.map((area) => svg("path", { ...stroke(area), class: "keep-out" })));
  }

  #courier(feeder, choose) {
    const { tray } = feeder;
    const [outer, inner] = [tray.outer_radius_m * MM, tray.inner_radius_m * MM];
    const half = (feeder.footprint_radius_m ?? tray.outer_radius_m) * MM * 0.8;
    const edge = (angle, radius) => `${radius * Math.cos(angle)} ${-radius * Math.sin(angle)}`;
    const ramp = tray.ramp_angle_rad;
    const isLong = ramp > Math.PI ? 1 : 0;
    const sector = `M${edge(0, outer)}A${outer} ${outer} 0 ${isLong} 0 ${edge(ramp, outer)}L${edge(ramp, inner)}A${inner} ${inner} 0 ${isLong} 1 ${edge(0, inner)}Z`;
    const name = svg("text", { class: "name", y: half + 16 * this.scale });
    setText(name, feeder.name);
    const state = svg("text", { class: "phase", y: half + 30 * this.scale });
    const turning = svg("g", {},
      svg("rect", { x: -half, y: -half, width: 2 * half, height: 2 * half, rx: 18, class: "courier" }),
      svg("circle", { r: outer, class: "plateau" }),
      svg("path", { d: sector, class: "ramp" }),
      svg("circle", { r: outer, class: "wall" }),
      svg("circle", { r: inner, class: "hub" }),
      svg("path", { d: `M${inner} 0H${outer}`, class: "drop" }));
    const group = svg("g", { class: "feeder", tabindex: 0, role: "button", "aria-label": `Show ${feeder.name}` }, turning, name, state);
    group.addEventListener("click", () => choose(feeder.name));
    group.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") {
        event.preventDefault();
        choose(feeder.name);
      }
    });
    this.couriers.append(group);
    return { feeder, group, turning, state };
  }

  #station(station) {
    const name = svg("text", { class: "name", y: -STATION_MM - 6 });
    setText(name, station.name);
    const jaws = svg("g", {},
      svg("path", { d: "M-4.5 -3v6M4.5 -3v6", class: "jaws" }));
    const group = svg("g", { class: "station", transform: `translate(${station.x_m * MM} ${-station.y_m * MM}) scale(${this.scale})` },
      svg("circle", { r: STATION_MM }), jaws,
      svg("path", { d: `M${-STATION_MM - 5} 0h5M${STATION_MM} 0h5M0 ${-STATION_MM - 5}v5M0 ${STATION_MM}v5`, class: "cross" }),
      name);
    this.stations.append(group);
    return { station, group, jaws };
  }

  /** @param {import("./playback.js").Moment} moment @param {string} focus name of the feeder that is looked at */
  draw({ older, newer, share }, focus) {
    for (const { feeder, group, turning, state } of this.feeders) {
      const now = newer.feeders[feeder.name];
      const before = older.feeders[feeder.name]?.courier;
      if (!now?.courier) {
        setAll(group, { visibility: "hidden" });
        continue;
      }
      const at = (key) => mix(before?.[key] ?? now.courier[key], now.courier[key], share);
      const [x, y, yaw] = [at("x_m") * MM, -at("y_m") * MM, (-at("yaw_rad") * 180) / Math.PI];
      const isFault = Boolean(now.courier_state?.fault || now.delivery?.fault);
      setAll(group, {
        visibility: null,
        transform: `translate(${x.toFixed(2)} ${y.toFixed(2)})`,
        class: `feeder ${feeder.name === focus ? "focus" : ""} ${isFault ? "fault" : ""}`,
      });
      setAll(turning, { transform: `rotate(${yaw.toFixed(3)})` });
      setText(state, isFault ? "fault" : now.courier_state?.vibrating ? "feeding" : (now.delivery?.phase ?? ""));
    }
    for (const { station, group, jaws } of this.tools) {
      const tool = newer.stations[station.name];
      setAll(jaws, { transform: `rotate(${((-(tool?.tool_yaw_rad ?? 0) * 180) / Math.PI).toFixed(1)})` });
      group.classList.toggle("down", (tool?.tool_z_m ?? 1) < 0.01);
    }
    this.#drawAreas(newer);
    this.#drawTrips(newer);
  }

  #drawAreas(frame) {
    keyed(this.areas, frame.leases ?? [], (lease) => lease.lease_id, () => svg("path"), (path, lease) =>
      setAll(path, { ...stroke(lease), class: `lease ${lease.overdue ? "overdue" : ""} ${lease.parked ? "parked" : ""}` }));
    keyed(this.status, frame.waiting ?? [], (agent) => agent, () => el("li"), (item, agent) =>
      setText(item, `${agent} waits for its area`));
  }

  #drawTrips(frame) {
    const trips = Object.entries(frame.feeders).filter(([, feeder]) => feeder.trip);
    keyed(this.trips, trips, ([name]) => name, () => svg("polyline", { class: "trip" }), (line, [, { trip }]) =>
      setAll(line, { points: trip.points_m.map(([x, y]) => `${(x * MM).toFixed(1)},${(-y * MM).toFixed(1)}`).join(" ") }));
  }
}

/** An area, the places within a radius of a line, as a stroke of that width. */
function stroke({ points_m: points, radius_m: radius }) {
  const at = ([x, y]) => `${(x * MM).toFixed(1)} ${(-y * MM).toFixed(1)}`;
  const [first, ...rest] = points;
  return {
    // A lone point is drawn too, as a line of no length with round ends.
    d: `M${at(first ?? [0, 0])}L${(rest.length > 0 ? rest : [first ?? [0, 0]]).map(at).join("L")}`,
    "stroke-width": (2 * radius * MM).toFixed(1),
  };
}
