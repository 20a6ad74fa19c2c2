// What the tray's view draws at a moment: bodies, shadows, marks, trails and tools, from two frames and the time between.

import { quatAbout } from "./mat4.js";
import { matched, verdict, VERDICTS } from "./match.js";
import { mix } from "./playback.js";
import { light, shade } from "./theme.js";
import { Trails } from "./trails.js";
import { normalAt } from "./tray_mesh.js";

/** A jump of more than this between two frames is a fall, not a motion, m. */
const JUMP_M = 0.02;
const FALLING = 2;
const GRAVITY_M_S2 = 9.80665;
const FLAT = [0, 0, 0, 1];

/** @typedef {import("./scene.js").Picture} Picture */

export class Painter {
  /** @param {any} hello @param {string} feeder name @param {number} partRadius m */
  constructor(hello, feeder, partRadius) {
    this.hello = hello;
    this.name = feeder;
    this.tray = hello.feeders.find(({ name }) => name === feeder).tray;
    this.partRadius = partRadius;
    this.trails = new Trails();
    /** Where parts that the selector alone knows are drawn, by its number. */
    this.seen = new Map();
    /** How each part lay when it was last on a surface, and the falls that have begun, by its number. */
    this.lay = new Map();
    this.falls = new Map();
    this.matchedAt = null;
    this.match = { byPart: new Map(), unmatched: [] };
    /** What is drawn of each part, for the list beside the picture and the tests. */
    this.shown = [];
  }

  /**
   * @param {import("./playback.js").Moment} moment @param {import("./playback.js").Playback} playback
   * @param {{truth: boolean, trails: boolean, marks: boolean}} options
   * @param {{x_m: number, y_m: number, yaw_rad: number}} courier where it is drawn
   * @returns {Picture}
   */
  paint(moment, playback, options, courier) {
    const state = moment.newer.feeders[this.name];
    this.#matchTo(state, playback);
    const parts = options.truth ? this.#trueParts(moment) : this.#seenParts(state);
    this.shown = parts;
    const chosen = nearestTo(state.delivery?.chosen, parts);
    const colour = (part) => light(VERDICTS[part.verdict].colour);
    const bodies = parts.filter(({ pose }) => pose !== null);
    return {
      centre: [courier.x_m, courier.y_m],
      yaw: courier.yaw_rad,
      bodies: bodies.map((part) => ({ ...part, tint: [...colour(part), 1] })),
      shadows: parts.filter(({ falls }) => !falls).map((part) => this.#onSurface(part.place, this.partRadius * 1.7, 0, [0, 0, 0, 0.42], 0.00009)),
      marks: options.marks ? this.#marks(parts, chosen) : [],
      trails: options.trails ? this.trails.ribbons(parts, moment.timeS, (part) => shade(VERDICTS[part.verdict].colour)) : new Float32Array(0),
      tools: this.#tools(moment.newer, courier),
    };
  }

  #matchTo(state, playback) {
    const stamp = state.candidates?.stamp_s ?? null;
    if (stamp !== this.matchedAt) {
      this.matchedAt = stamp;
      this.match = matched(state.candidates, stamp === null ? null : playback.truthNear(stamp, this.name));
    }
  }

  /** The parts that are there, where they truly lie. */
  #trueParts({ older, newer, share, timeS }) {
    const truth = newer.feeders[this.name].truth;
    const before = older.feeders[this.name]?.truth;
    if (!truth) {
      return [];
    }
    const where = new Map(before?.id.map((id, index) => [id, index]) ?? []);
    const parts = truth.id.map((id, index) => {
      const place = truth.position_m.slice(index * 3, index * 3 + 3);
      const turn = truth.orientation_xyzw.slice(index * 4, index * 4 + 4);
      const was = where.get(id);
      if (was !== undefined) {
        moveBack(place, turn, before.position_m.slice(was * 3, was * 3 + 3), before.orientation_xyzw.slice(was * 4, was * 4 + 4), share);
      }
      if (truth.surface[index] === FALLING) {
        this.#fall(id, place, turn, timeS);
      } else {
        this.lay.set(id, turn);
        this.falls.delete(id);
      }
      const found = this.match.byPart.get(id);
      return {
        id, place, turn,
        pose: truth.pose[index],
        falls: truth.surface[index] === FALLING,
        verdict: truth.surface[index] === FALLING ? "unseen" : verdict(found?.candidate),
        candidate: found?.candidate ?? null,
        off: found?.off ?? null,
        sticks: truth.sticking[index] === 1,
        stranded: truth.stranded[index] === 1,
        speed: truth.track_speed_m_s[index],
      };
    });
    const ghosts = this.match.unmatched.map((candidate) => ({ ...this.#asSeen(candidate), pose: null }));
    return [...parts, ...ghosts];
  }

  /**
   * Moves a part that falls over the drop-off to where free fall has brought it, turning over on its way. The simulator
   * leaves it at the edge until it has come to lie.
   */
  #fall(id, place, turn, timeS) {
    const lay = this.lay.get(id) ?? turn;
    const begun = this.falls.get(id);
    // Time may have gone back.
    const fall = begun && begun.sinceS <= timeS ? begun : { sinceS: timeS };
    this.falls.set(id, fall);
    const since = timeS - fall.sinceS;
    const share = Math.min(1, since / Math.sqrt((2 * this.tray.rise_m) / GRAVITY_M_S2));
    // Past the edge, counter-clockwise, by as much as it is wide.
    const [r, angle] = [Math.hypot(place[0], place[1]), Math.atan2(place[1], place[0])];
    const past = angle + (share * 2 * this.partRadius) / r;
    place[0] = r * Math.cos(past);
    place[1] = r * Math.sin(past);
    place[2] -= share * share * this.tray.rise_m;
    turnBetween(turn, lay, share);
  }

  /** The parts that the selector knows, where it takes them to be. */
  #seenParts(state) {
    const parts = (state.candidates?.parts ?? []).map((candidate) => {
      const part = this.#asSeen(candidate);
      // It speaks a few times a second: between, parts glide to where it last saw them.
      const last = this.seen.get(candidate.id);
      if (last && Math.hypot(last[0] - part.place[0], last[1] - part.place[1]) < JUMP_M) {
        part.place = part.place.map((value, axis) => mix(last[axis], value, 0.25));
      }
      return part;
    });
    this.seen = new Map(parts.map((part) => [part.id, part.place]));
    return parts;
  }

  #asSeen(candidate) {
    const { orientation_xyzw: turn, pose_class: pose } = candidate;
    const index = this.hello.part.poses.findIndex(({ name }) => name === pose);
    return {
      id: candidate.id,
      place: [candidate.x_m, candidate.y_m, candidate.origin_z_m ?? candidate.z_m],
      turn: turn ?? FLAT,
      pose: index < 0 ? null : index,
      falls: false,
      verdict: verdict(candidate),
      candidate,
      off: [0, 0],
      sticks: null,
      stranded: false,
      speed: null,
    };
  }

  #marks(parts, chosen) {
    const marks = [];
    for (const part of parts) {
      const { look, colour } = VERDICTS[part.verdict];
      const radius = part.candidate?.radius_m ?? this.partRadius;
      if (part === chosen) {
        marks.push(this.#onSurface(part.place, radius * 3, 5, [...shade("chosen"), 0.95], 0.0003));
      }
      if (look !== null && part.off) {
        const at = [part.place[0] + part.off[0], part.place[1] + part.off[1], part.place[2]];
        marks.push(this.#onSurface(at, radius * 1.9, look, [...shade(colour), 1], 0.00025));
      }
      if (part.stranded) {
        marks.push(this.#onSurface(part.place, radius * 2, 4, [...shade("bad"), 1], 0.00025));
      }
    }
    return marks;
  }

  /** A mark that lies flat on the running surface below a place. */
  #onSurface(place, size, look, tint, lift) {
    const angle = (Math.atan2(place[1], place[0]) + 2 * Math.PI) % (2 * Math.PI);
    const r = Math.hypot(place[0], place[1]);
    const { tray } = this;
    const isRamp = angle < tray.ramp_angle_rad;
    const height = isRamp ? (tray.rise_m * angle) / tray.ramp_angle_rad : tray.rise_m;
    const slope = isRamp ? Math.acos(Math.min(1, normalAt(tray, r, angle)[2])) : 0;
    return { place: [place[0], place[1], height + lift], turn: quatAbout([Math.cos(angle), Math.sin(angle), 0], slope), size, look, tint };
  }

  #tools(frame, courier) {
    return this.hello.stations.filter(({ serves }) => serves.includes(this.name)).map((station) => {
      const tool = frame.stations[station.name];
      const z = this.tray.rise_m + (tool?.tool_z_m ?? 0.05);
      return { place: [station.x_m - courier.x_m, station.y_m - courier.y_m, z], yaw: tool?.tool_yaw_rad ?? 0 };
    });
  }
}

/** Moves a place and a turn back to what lies between them and those before. */
function moveBack(place, turn, placeBefore, turnBefore, share) {
  const jump = Math.hypot(place[0] - placeBefore[0], place[1] - placeBefore[1], place[2] - placeBefore[2]);
  if (jump > JUMP_M) {
    return;
  }
  for (let axis = 0; axis < 3; axis += 1) {
    place[axis] = mix(placeBefore[axis], place[axis], share);
  }
  turnBetween(turn, turnBefore, share);
}

/** Turns a turn back to what lies between it and the one before. */
function turnBetween(turn, turnBefore, share) {
  const sign = turn.reduce((sum, value, i) => sum + value * turnBefore[i], 0) < 0 ? -1 : 1;
  turn.forEach((value, i) => {
    turn[i] = mix(turnBefore[i], value * sign, share);
  });
  const length = Math.hypot(...turn);
  turn.forEach((value, i) => {
    turn[i] = value / length;
  });
}

function nearestTo(chosen, parts) {
  if (!chosen) {
    return null;
  }
  const far = (part) => Math.hypot(part.place[0] - chosen.x_m, part.place[1] - chosen.y_m);
  const best = parts.reduce((a, b) => (!a || far(b) < far(a) ? b : a), null);
  return best && far(best) < 0.006 ? best : null;
}
