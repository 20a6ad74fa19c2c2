// Where parts have come from: a ribbon behind each, fading with age.

/** How far back a trail goes, and how often a point is kept, in simulated seconds. */
const LENGTH_S = 4;
const STEP_S = 0.08;
const HALF_WIDTH_M = 0.00042;
const LIFT_M = 0.00018;
const OPACITY = 0.5;
/** A longer step is a fall, m. */
const JUMP_M = 0.02;

export class Trails {
  constructor() {
    /** @type {Map<number, {x: number, y: number, z: number, t: number}[]>} */
    this.points = new Map();
    this.buffer = new Float32Array(0);
  }

  /**
   * The ribbons of these parts as triangles, each point with its colour.
   * @param {{id: number, place: number[], falls: boolean}[]} parts @param {number} now simulated time, s
   * @param {(part: any) => number[]} colour as it goes to the screen
   */
  ribbons(parts, now, colour) {
    this.#remember(parts, now);
    const values = [];
    for (const part of parts) {
      const points = this.points.get(part.id);
      if (points) {
        ribbon(values, [...points, { x: part.place[0], y: part.place[1], z: part.place[2], t: now }], now, colour(part));
      }
    }
    return new Float32Array(values);
  }

  #remember(parts, now) {
    const present = new Set();
    for (const { id, place: [x, y, z], falls } of parts) {
      present.add(id);
      const points = this.points.get(id) ?? [];
      const last = points.at(-1);
      const hasJumped = last && (now < last.t || Math.hypot(last.x - x, last.y - y, last.z - z) > JUMP_M);
      if (falls || hasJumped) {
        points.length = 0;
      }
      if (!falls && (points.length === 0 || now - last.t >= STEP_S)) {
        points.push({ x, y, z, t: now });
      }
      while (points.length > 0 && now - points[0].t > LENGTH_S) {
        points.shift();
      }
      this.points.set(id, points);
    }
    for (const id of this.points.keys()) {
      if (!present.has(id)) {
        this.points.delete(id);
      }
    }
  }
}

function ribbon(values, points, now, [red, green, blue]) {
  let before = null;
  for (let i = 1; i < points.length; i += 1) {
    const [a, b] = [points[i - 1], points[i]];
    const [dx, dy] = [b.x - a.x, b.y - a.y];
    const length = Math.hypot(dx, dy);
    if (length < 1e-5) {
      continue;
    }
    const side = [(-dy / length) * HALF_WIDTH_M, (dx / length) * HALF_WIDTH_M];
    const corner = (p, sign, shift) => [p.x + sign * shift[0], p.y + sign * shift[1], p.z + LIFT_M, red, green, blue, OPACITY * Math.max(0, 1 - (now - p.t) / LENGTH_S)];
    const from = before ?? side;
    const [a1, a2, b1, b2] = [corner(a, 1, from), corner(a, -1, from), corner(b, 1, side), corner(b, -1, side)];
    values.push(...a1, ...a2, ...b2, ...a1, ...b2, ...b1);
    before = side;
  }
}
