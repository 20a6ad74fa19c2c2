// The tray as triangles, made from its geometry: ramp, plateau, drop-off, walls, hub, and the courier that carries it.
//
// In the tray's frame: z is up from the foot of the ramp, angles go counter-clockwise from there. Each point has a place,
// a normal, a material (an index into the palette that the shader is given) and a shade that darkens corners.

/** What things are made of; the order is that of the palette. */
export const MATERIAL = { ramp: 0, plateau: 1, wall: 2, hub: 3, drop: 4, courier: 5, mark: 6, tool: 7 };

const TAU = 2 * Math.PI;
/** Steps round the tray. */
const STEPS = 144;
/** Depth of the tray's body below the foot of the ramp, m; below it is the courier. Only drawn so. */
const BODY_DEPTH_M = 0.009;
/** Rounding of edges, m. */
const BEVEL_M = 0.0006;

/** Collects triangles. */
export class Shape {
  constructor() {
    /** @type {number[]} */
    this.values = [];
  }

  /** A corner: a place, a normal and a shade. */
  #put(material, [place, normal, shade]) {
    this.values.push(...place, ...normal, material, shade);
  }

  /** Four corners in order round, each [place, normal, shade]. */
  quad(material, a, b, c, d) {
    for (const corner of [a, b, c, a, c, d]) {
      this.#put(material, corner);
    }
    return this;
  }

  triangle(material, a, b, c) {
    for (const corner of [a, b, c]) {
      this.#put(material, corner);
    }
    return this;
  }

  points() {
    return new Float32Array(this.values);
  }
}

const polar = (r, angle, z) => [r * Math.cos(angle), r * Math.sin(angle), z];
const outward = (angle) => [Math.cos(angle), Math.sin(angle), 0];
const inward = (angle) => [-Math.cos(angle), -Math.sin(angle), 0];
const UP = [0, 0, 1];
/** Which way the drop-off looks: on along the track. */
const ONWARD = [0, 1, 0];

/** Height of the running surface, m. @param {any} tray geometry @param {number} angle in [0, 2π] */
export function heightAt(tray, angle) {
  return angle < tray.ramp_angle_rad ? (tray.rise_m * angle) / tray.ramp_angle_rad : tray.rise_m;
}

/** Normal of the running surface. @returns {[number, number, number]} */
export function normalAt(tray, r, angle) {
  if (angle >= tray.ramp_angle_rad) {
    return UP;
  }
  const slope = tray.rise_m / tray.ramp_angle_rad / r;
  const scale = 1 / Math.hypot(1, slope);
  return [slope * Math.sin(angle) * scale, -slope * Math.cos(angle) * scale, scale];
}

/**
 * @typedef {{outer_radius_m: number, inner_radius_m: number, rise_m: number, ramp_angle_rad: number, floor_height_m: number,
 *   lip_m: number, wall_thickness_m: number}} Tray
 */

/** All of the tray but its glass. @param {Tray} tray */
export function trayPoints(tray) {
  const shape = new Shape();
  surface(shape, tray);
  walls(shape, tray);
  dropOff(shape, tray);
  hub(shape, tray);
  scale(shape, tray);
  return shape.points();
}

/** Angles round the tray, with an edge where ramp and plateau meet. */
function angles(tray) {
  const ramp = Math.round((STEPS * tray.ramp_angle_rad) / TAU);
  const level = STEPS - ramp;
  const on = Array.from({ length: ramp }, (_, i) => (i * tray.ramp_angle_rad) / ramp);
  const off = Array.from({ length: level + 1 }, (_, i) => tray.ramp_angle_rad + (i * (TAU - tray.ramp_angle_rad)) / level);
  return [...on, ...off];
}

function steps(tray, each) {
  const round = angles(tray);
  for (let i = 0; i + 1 < round.length; i += 1) {
    // Just before the next angle, so that a step's end belongs to the surface it began on.
    each(round[i], round[i + 1], round[i] < tray.ramp_angle_rad ? MATERIAL.ramp : MATERIAL.plateau);
  }
}

function surface(shape, tray) {
  const { inner_radius_m: inner, outer_radius_m: outer } = tray;
  const rings = [
    [inner, 0.5], [inner + 0.0015, 0.74], [inner + 0.006, 0.95], [inner + 0.012, 1],
    [outer - 0.008, 1], [outer - 0.004, 0.95], [outer - 0.001, 0.78], [outer, 0.6],
  ];
  // The foot lies in the shade of the drop-off.
  const foot = (angle) => Math.min(1, 0.55 + 0.45 * Math.sqrt(angle / 0.5));
  steps(tray, (from, to, material) => {
    const height = (angle) => (material === MATERIAL.ramp ? (tray.rise_m * angle) / tray.ramp_angle_rad : tray.rise_m);
    const normal = (r, angle) => (material === MATERIAL.ramp ? normalAt(tray, r, Math.min(angle, tray.ramp_angle_rad - 1e-9)) : UP);
    const corner = ([r, shade], angle) => [polar(r, angle, height(angle)), normal(r, angle), shade * foot(angle)];
    for (let i = 0; i + 1 < rings.length; i += 1) {
      shape.quad(material, corner(rings[i], from), corner(rings[i + 1], from), corner(rings[i + 1], to), corner(rings[i], to));
    }
  });
}

/** The outer wall below the running surface. What stands above it is drawn as glass, or it would hide the ramp. */
function walls(shape, tray) {
  const { outer_radius_m: outer, rise_m: rise, wall_thickness_m: thickness } = tray;
  const rim = outer + thickness;
  steps(tray, (from, to, material) => {
    const top = (angle) => (material === MATERIAL.ramp ? (rise * angle) / tray.ramp_angle_rad : rise);
    const band = (lower, upper, normal, shades) =>
      shape.quad(MATERIAL.wall,
        [lower(from), normal(from), shades[0]], [lower(to), normal(to), shades[0]],
        [upper(to), normal(to), shades[1]], [upper(from), normal(from), shades[1]]);
    band((a) => polar(outer, a, top(a)), (a) => polar(rim - BEVEL_M, a, top(a)), () => UP, [0.95, 1.08]);
    band((a) => polar(rim - BEVEL_M, a, top(a)), (a) => polar(rim, a, top(a) - BEVEL_M), tilted, [1.2, 1.2]);
    band((a) => polar(rim, a, -BODY_DEPTH_M), (a) => polar(rim, a, top(a) - BEVEL_M), outward, [0.6, 0.95]);
  });
}

/** The outer wall above the running surface. @param {Tray} tray */
export function glassPoints(tray) {
  const shape = new Shape();
  const { outer_radius_m: outer, rise_m: rise, wall_thickness_m: thickness } = tray;
  const rim = outer + thickness;
  const top = rise + tray.lip_m;
  steps(tray, (from, to, material) => {
    const low = (angle) => (material === MATERIAL.ramp ? (rise * angle) / tray.ramp_angle_rad : rise);
    const side = (r, normal) =>
      shape.quad(MATERIAL.wall,
        [polar(r, from, low(from)), normal(from), 1], [polar(r, to, low(to)), normal(to), 1],
        [polar(r, to, top), normal(to), 1.3], [polar(r, from, top), normal(from), 1.3]);
    side(rim, outward);
    side(outer, inward);
    const lid = (r, angle) => [polar(r, angle, top), UP, 2.2];
    shape.quad(MATERIAL.wall, lid(outer, from), lid(rim, from), lid(rim, to), lid(outer, to));
  });
  return shape.points();
}

const tilted = (angle) => [Math.cos(angle) * 0.7, Math.sin(angle) * 0.7, 0.71];

function dropOff(shape, tray) {
  const { inner_radius_m: inner, outer_radius_m: outer, rise_m: rise } = tray;
  const face = (near, far, low, high, material) =>
    shape.quad(material,
      [[near, 0, low], ONWARD, 0.5], [[far, 0, low], ONWARD, 0.5], [[far, 0, high], ONWARD, 1], [[near, 0, high], ONWARD, 1]);
  face(inner, outer, 0, rise, MATERIAL.drop);
  face(outer, outer + tray.wall_thickness_m, 0, rise, MATERIAL.wall);
  // The edge over which parts fall is marked.
  const at = (r, angle) => [polar(r, angle, rise + 0.00006), UP, 1];
  const width = 0.0012;
  shape.quad(MATERIAL.mark, at(inner + 0.001, TAU - width / inner), at(outer - 0.001, TAU - width / outer), at(outer - 0.001, TAU), at(inner + 0.001, TAU));
}

function hub(shape, tray) {
  const { inner_radius_m: radius, rise_m: rise } = tray;
  const top = rise + tray.lip_m;
  const bevel = 2 * BEVEL_M;
  const bore = radius * 0.32;
  for (let i = 0; i < STEPS; i += 1) {
    const [a, b] = [(i * TAU) / STEPS, ((i + 1) * TAU) / STEPS];
    const ring = (r, z, normal, shade) => [[polar(r, a, z), normal(a), shade], [polar(r, b, z), normal(b), shade]];
    const band = (low, high) => shape.quad(MATERIAL.hub, low[0], low[1], high[1], high[0]);
    const lowShade = 0.55 + 0.3 * Math.min(1, heightAt(tray, a) / rise);
    band(ring(radius, 0, outward, lowShade), ring(radius, top - bevel, outward, 0.95));
    band(ring(radius, top - bevel, tilted, 1.2), ring(radius - bevel, top, tilted, 1.2));
    band(ring(radius - bevel, top, () => UP, 1), ring(bore, top, () => UP, 0.96));
    band(ring(bore, top, inward, 0.7), ring(bore, top - 0.006, inward, 0.25));
    shape.triangle(MATERIAL.hub, [[0, 0, top - 0.006], UP, 0.3], ...ring(bore, top - 0.006, () => UP, 0.25));
  }
  arrow(shape, radius * 0.68, top + 0.00006);
}

/** Which way parts go: an arc with a head, counter-clockwise. */
function arrow(shape, r, z) {
  const half = 0.0009;
  const [start, end] = [0.7 * Math.PI, 1.25 * Math.PI];
  const at = (radius, angle) => [polar(radius, angle, z), UP, 1];
  const count = 24;
  for (let i = 0; i < count; i += 1) {
    const [a, b] = [i, i + 1].map((k) => start + ((end - start) * k) / count);
    shape.quad(MATERIAL.mark, at(r - half, a), at(r + half, a), at(r + half, b), at(r - half, b));
  }
  shape.triangle(MATERIAL.mark, at(r - 0.0034, end), at(r + 0.0034, end), at(r, end + 0.3));
}

/** A scale on the outer wall: a tick each ten degrees, a longer one each thirty. */
function scale(shape, tray) {
  const z = (angle) => heightAt(tray, angle) + 0.00006;
  const rim = tray.outer_radius_m + tray.wall_thickness_m - BEVEL_M;
  for (let tick = 0; tick < 36; tick += 1) {
    const angle = (tick * TAU) / 36 + 0.0025;
    const half = 0.0022;
    const inner = rim - (tick % 3 === 0 ? 0.0021 : 0.0013);
    const at = (r, a) => [polar(r, a, z(a)), UP, 1];
    shape.quad(MATERIAL.mark, at(inner, angle - half), at(rim, angle - half), at(rim, angle + half), at(inner, angle + half));
  }
}

/**
 * The courier below the tray, a block with round corners.
 * @param {number} radius of the disc that covers it, m @param {number} floor height of the ramp's foot above the platen, m
 */
export function courierPoints(radius, floor) {
  const shape = new Shape();
  const half = radius * 0.8;
  const corner = radius * 0.22;
  const top = -BODY_DEPTH_M;
  const bottom = -floor + 0.0015;
  const bevel = 2 * BEVEL_M;
  const outline = (inset) => {
    const points = [];
    for (let i = 0; i < 4; i += 1) {
      for (let k = 0; k <= 10; k += 1) {
        const angle = ((i + k / 10) * Math.PI) / 2;
        const centre = [(half - corner) * (i === 0 || i === 3 ? 1 : -1), (half - corner) * (i < 2 ? 1 : -1)];
        points.push([centre[0] + (corner - inset) * Math.cos(angle), centre[1] + (corner - inset) * Math.sin(angle), angle]);
      }
    }
    return points;
  };
  const [side, lid] = [outline(0), outline(bevel)];
  side.forEach((a, i) => {
    const b = side[(i + 1) % side.length];
    const [c, d] = [lid[i], lid[(i + 1) % lid.length]];
    const at = (p, z, normal, shade) => [[p[0], p[1], z], normal, shade];
    shape.quad(MATERIAL.courier, at(a, bottom, outward(a[2]), 0.55), at(b, bottom, outward(b[2]), 0.55), at(b, top - bevel, outward(b[2]), 1), at(a, top - bevel, outward(a[2]), 1));
    shape.quad(MATERIAL.courier, at(a, top - bevel, tilted(a[2]), 1.25), at(b, top - bevel, tilted(b[2]), 1.25), at(d, top, tilted(d[2]), 1.25), at(c, top, tilted(c[2]), 1.25));
    shape.triangle(MATERIAL.courier, at(c, top, UP, 0.9), at(d, top, UP, 0.9), [[0, 0, top], UP, 0.5]);
  });
  return shape.points();
}

/** A station's tool: a shaft with two jaws, its tip at the origin. */
export function toolPoints() {
  const shape = new Shape();
  const count = 28;
  for (let i = 0; i < count; i += 1) {
    const [a, b] = [(i * TAU) / count, ((i + 1) * TAU) / count];
    const ring = (r, z, shade) => [[polar(r, a, z), outward(a), shade], [polar(r, b, z), outward(b), shade]];
    const tube = (r, low, high) => {
      const [l, h] = [ring(r, low, 0.8), ring(r, high, 1)];
      shape.quad(MATERIAL.tool, l[0], l[1], h[1], h[0]);
      shape.triangle(MATERIAL.tool, [[0, 0, high], UP, 1], [polar(r, a, high), UP, 1], [polar(r, b, high), UP, 1]);
      shape.triangle(MATERIAL.tool, [[0, 0, low], [0, 0, -1], 0.6], [polar(r, a, low), [0, 0, -1], 0.6], [polar(r, b, low), [0, 0, -1], 0.6]);
    };
    tube(0.004, 0.022, 0.16);
    tube(0.0075, 0.012, 0.024);
  }
  for (const sign of [-1, 1]) {
    box(shape, [sign * 0.0042 - 0.0008, -0.0016, 0], [sign * 0.0042 + 0.0008, 0.0016, 0.013]);
  }
  return shape.points();
}

function box(shape, low, high) {
  for (let axis = 0; axis < 3; axis += 1) {
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    for (const end of [low, high]) {
      const normal = [0, 0, 0];
      normal[axis] = end === high ? 1 : -1;
      const corner = (a, b) => {
        const place = [0, 0, 0];
        place[axis] = end[axis];
        place[u] = a[u];
        place[v] = b[v];
        return [place, normal, 1];
      };
      shape.quad(MATERIAL.tool, corner(low, low), corner(high, low), corner(high, high), corner(low, high));
    }
  }
}
