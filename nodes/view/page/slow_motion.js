// The tray's motion sample by sample, which comes while the run is slow: vibration as it is, not only as frames catch it.

import { mix } from "./playback.js";

/** Blocks that are kept. */
const KEPT = 24;

export class SlowMotion {
  constructor() {
    this.clear();
  }

  clear() {
    /** @type {any[]} */
    this.blocks = [];
  }

  /** @param {any} block a servo message */
  push(block) {
    if (block.start_s < (this.blocks.at(-1)?.start_s ?? -Infinity)) {
      this.clear();
    }
    this.blocks.push(block);
    this.blocks.splice(0, this.blocks.length - KEPT);
  }

  /** Where the tray was at a time, if a block tells. @param {number} timeS */
  at(timeS) {
    const block = this.blocks.findLast(({ start_s: start }) => start <= timeS);
    if (!block) {
      return null;
    }
    const place = (timeS - block.start_s) / block.sample_period_s;
    const index = Math.floor(place);
    const next = this.blocks[this.blocks.indexOf(block) + 1];
    if (index >= block.yaw_rad.length || (index === block.yaw_rad.length - 1 && !next)) {
      return null;
    }
    const value = (key) => mix(block[key][index], block[key][index + 1] ?? next[key][0], place - index);
    return { x_m: value("x_m"), y_m: value("y_m"), yaw_rad: value("yaw_rad") };
  }
}
