// Parts as triangles, ready to be lit: sharp edges stay sharp, round ones become round.

import { cross, dot, normalize, subtract } from "./mat4.js";

/** Faces that meet at less than this angle are one round surface. */
const ROUND_COS = Math.cos(0.62);

/**
 * The points of a part's mesh: place, normal, material and shade of each corner, in the part's own frame.
 * @param {{vertices_m: number[], triangles: number[]}} part
 * @returns {Float32Array}
 */
export function partPoints(part) {
  const { vertices_m: values, triangles } = part;
  const vertex = (index) => /** @type {any} */ (values.slice(index * 3, index * 3 + 3));
  const faces = [];
  const around = new Map();
  for (let i = 0; i + 2 < triangles.length; i += 3) {
    const corners = triangles.slice(i, i + 3).map(vertex);
    const normal = cross(subtract(corners[1], corners[0]), subtract(corners[2], corners[0]));
    const face = { corners, area: normal, normal: normalize(normal) };
    faces.push(face);
    for (const corner of corners) {
      const place = key(corner);
      around.set(place, [...(around.get(place) ?? []), face]);
    }
  }
  const points = [];
  for (const face of faces) {
    for (const corner of face.corners) {
      const sum = [0, 0, 0];
      for (const other of around.get(key(corner))) {
        if (dot(other.normal, face.normal) > ROUND_COS) {
          other.area.forEach((value, axis) => {
            sum[axis] += value;
          });
        }
      }
      points.push(...corner, ...normalize(/** @type {any} */ (sum)), 0, 1);
    }
  }
  return new Float32Array(points);
}

/** Vertices at the same place are one, whatever their number. */
const key = (corner) => corner.map((value) => Math.round(value * 1e7)).join();

/** Radius of a ball about the origin that holds the part, m. */
export function partRadius(part) {
  let radius = 0;
  for (let i = 0; i + 2 < part.vertices_m.length; i += 3) {
    radius = Math.max(radius, Math.hypot(...part.vertices_m.slice(i, i + 3)));
  }
  return radius;
}
