// Plays the frames that have come, a little behind the newest, so that motion is smooth between them.

/** Frames that are kept: those of the last seconds of playing. */
const KEPT = 90;
/** How far behind the newest frame is played, in frames. */
const BEHIND = 1.6;
/** Close enough to a frame to be at it, s. */
const NEAR_S = 1e-4;

/**
 * @typedef {{time_s: number}} Frame
 * @typedef {{older: any, newer: any, share: number, timeS: number}} Moment
 */

export class Playback {
  constructor() {
    this.clear();
  }

  clear() {
    /** @type {{frame: any, at: number}[]} */
    this.frames = [];
    this.headS = null;
    this.lastAt = null;
  }

  /** @param {Frame} frame @param {number} now when it came, ms */
  push(frame, now) {
    const newest = this.frames.at(-1);
    if (newest && frame.time_s < newest.frame.time_s) {
      // Another run has begun.
      this.clear();
    }
    if (newest && frame.time_s === newest.frame.time_s) {
      newest.frame = frame;
    } else {
      this.frames.push({ frame, at: now });
      this.frames.splice(0, this.frames.length - KEPT);
    }
  }

  get newest() {
    return this.frames.at(-1)?.frame ?? null;
  }

  /** Simulated seconds for each second of the wall clock, of late. */
  get rate() {
    const [first, last] = [this.frames.at(-Math.min(12, this.frames.length)), this.frames.at(-1)];
    const wall = (last?.at - first?.at) / 1000;
    return wall > 0 ? (last.frame.time_s - first.frame.time_s) / wall : 0;
  }

  /** What is to be shown now. @param {number} now ms @returns {Moment | null} */
  moment(now) {
    const { frames } = this;
    if (frames.length === 0) {
      return null;
    }
    const newest = frames.at(-1).frame.time_s;
    const step = frames.length > 1 ? (newest - frames.at(-Math.min(8, frames.length)).frame.time_s) / Math.max(1, Math.min(8, frames.length) - 1) : 0;
    const seconds = this.lastAt === null ? 0 : Math.min(0.25, (now - this.lastAt) / 1000);
    this.lastAt = now;
    const goal = newest - BEHIND * step;
    const isStale = frames.at(-1).frame.paused || now - frames.at(-1).at > 400 + 3000 * step;
    if (this.headS === null || Math.abs(this.headS - newest) > Math.max(6 * step, 1e-9) * 2) {
      this.headS = goal;
    } else if (isStale) {
      // Nothing comes any more: the last frame is where it stands.
      const left = newest - this.headS;
      this.headS = Math.abs(left) < NEAR_S ? newest : this.headS + left * Math.min(1, seconds * 8);
    } else {
      this.headS += this.rate * seconds;
      this.headS += (goal - this.headS) * Math.min(1, seconds * 2.5);
    }
    this.headS = Math.min(this.headS, newest);
    return this.#around(this.headS);
  }

  /** @param {number} timeS @returns {Moment} */
  #around(timeS) {
    const { frames } = this;
    let at = frames.length - 1;
    while (at > 0 && frames[at - 1].frame.time_s >= timeS) {
      at -= 1;
    }
    const newer = frames[at].frame;
    const older = frames[Math.max(0, at - 1)].frame;
    const span = newer.time_s - older.time_s;
    const share = span > 0 ? Math.min(1, Math.max(0, (timeS - older.time_s) / span)) : 1;
    return { older, newer, share, timeS };
  }

  /** The frame whose truth is nearest to a time. @param {number} timeS @param {string} feeder */
  truthNear(timeS, feeder) {
    let best = null;
    for (const { frame } of this.frames) {
      const truth = frame.feeders[feeder]?.truth;
      if (truth && (!best || Math.abs(truth.stamp_s - timeS) < Math.abs(best.stamp_s - timeS))) {
        best = truth;
      }
    }
    return best;
  }
}

/** Between two values. */
export const mix = (a, b, share) => a + (b - a) * share;
