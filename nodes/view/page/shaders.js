// The shaders of the tray's view: lit bodies, marks that lie on a surface, trails, and the platen below.

/** Places of the attributes, the same in every program. */
export const AT = { place: 0, normal: 1, material: 2, shade: 3, offset: 4, turn: 5, tint: 6, colour: 1, size: 6, look: 7 };

const TURNED = `
vec3 turned(vec4 q, vec3 v) {
  return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}`;

/** Bodies under a key light, a fill light and the sky. */
export const LIT = {
  vertex: `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 normal;
layout(location = 2) in float material;
layout(location = 3) in float shade;
layout(location = 4) in vec3 offset;
layout(location = 5) in vec4 turn;
layout(location = 6) in vec4 tint;
uniform mat4 camera;
uniform vec3 palette[8];
out vec3 at;
out vec3 facing;
out vec3 colour;
${TURNED}
void main() {
  at = turned(turn, place) + offset;
  facing = turned(turn, normal);
  colour = mix(palette[int(material + 0.5)], tint.rgb, tint.a) * shade;
  gl_Position = camera * vec4(at, 1.0);
}`,
  fragment: `#version 300 es
precision highp float;
in vec3 at;
in vec3 facing;
in vec3 colour;
uniform vec3 eye;
uniform vec3 sky;
uniform vec3 ground;
uniform float gloss;
uniform float opacity;
out vec4 pixel;
const vec3 KEY = vec3(-0.37, -0.33, 0.868);
const vec3 FILL = vec3(0.76, 0.36, 0.54);
void main() {
  vec3 n = normalize(facing);
  vec3 view = normalize(eye - at);
  vec3 lit = mix(ground, sky, n.z * 0.5 + 0.5);
  lit += vec3(1.0, 0.985, 0.95) * 0.78 * max(dot(n, KEY), 0.0);
  lit += vec3(0.82, 0.9, 1.0) * 0.2 * max(dot(n, FILL), 0.0);
  float shine = pow(max(dot(n, normalize(KEY + view)), 0.0), 42.0) * gloss;
  float edge = pow(1.0 - max(dot(n, view), 0.0), 4.0) * gloss * 0.5;
  pixel = vec4(pow(colour * lit + shine + edge * sky, vec3(1.0 / 2.2)), opacity);
}`,
};

/**
 * Flat marks on a surface: look 0 is a soft shadow, 1 a whole ring, 2 a dashed ring, 3 a diamond, 4 a ring with a cross,
 * 5 a wide soft ring.
 */
export const MARK = {
  vertex: `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 4) in vec3 offset;
layout(location = 5) in vec4 turn;
layout(location = 6) in vec4 tint;
layout(location = 7) in vec2 look;
uniform mat4 camera;
out vec2 at;
out vec4 colour;
flat out int kind;
${TURNED}
void main() {
  at = place.xy;
  colour = tint;
  kind = int(look.y + 0.5);
  gl_Position = camera * vec4(turned(turn, place * look.x) + offset, 1.0);
}`,
  fragment: `#version 300 es
precision highp float;
in vec2 at;
in vec4 colour;
flat in int kind;
out vec4 pixel;
float line(float distance, float half_width) {
  float soft = fwidth(distance);
  return 1.0 - smoothstep(half_width - soft, half_width + soft, abs(distance));
}
void main() {
  float r = length(at);
  float cover;
  if (kind == 0) {
    cover = smoothstep(1.0, 0.25, r);
  } else if (kind == 3) {
    cover = line(abs(at.x) + abs(at.y) - 0.82, 0.08);
  } else if (kind == 5) {
    cover = exp(-pow((r - 0.75) / 0.13, 2.0)) * smoothstep(1.0, 0.9, r);
  } else {
    cover = line(r - 0.85, 0.075);
    if (kind == 2) {
      cover *= step(0.42, fract(atan(at.y, at.x) * 8.0 / 6.2831853));
    } else if (kind == 4) {
      cover = max(cover, line(min(abs(at.x), abs(at.y)), 0.05) * step(0.5, r) * step(r, 1.0));
    }
  }
  pixel = vec4(colour.rgb, colour.a * cover);
  if (pixel.a < 0.004) discard;
}`,
};

/** Bands of one colour each that fade; the colours come ready for the screen. */
export const TRAIL = {
  vertex: `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 colour;
uniform mat4 camera;
uniform vec4 turn;
uniform vec3 offset;
out vec4 mixed;
${TURNED}
void main() {
  mixed = colour;
  gl_Position = camera * vec4(turned(turn, place) + offset, 1.0);
}`,
  fragment: `#version 300 es
precision mediump float;
in vec4 mixed;
out vec4 pixel;
void main() { pixel = mixed; }`,
};

/** The platen: a grid of 10 and 100 mm, the shadow of the courier, and fading into the background far away. */
export const PLATEN = {
  vertex: `#version 300 es
layout(location = 0) in vec3 place;
uniform mat4 camera;
uniform float level;
out vec2 at;
void main() {
  at = place.xy;
  gl_Position = camera * vec4(place.xy, level, 1.0);
}`,
  fragment: `#version 300 es
precision highp float;
in vec2 at;
uniform vec2 centre;
uniform float radius;
uniform vec3 floor_colour;
uniform vec3 line_colour;
uniform vec3 far_colour;
out vec4 pixel;
float grid(vec2 p, float step_m, float width) {
  vec2 q = p / step_m;
  vec2 wide = fwidth(q);
  vec2 d = abs(fract(q - 0.5) - 0.5) / max(wide, vec2(1e-6));
  float fade = 1.0 - smoothstep(0.15, 0.5, max(wide.x, wide.y));
  return (1.0 - smoothstep(width, width + 1.0, min(d.x, d.y))) * fade;
}
void main() {
  vec2 p = at + centre;
  float lines = max(grid(p, 0.01, 0.1) * 0.28, grid(p, 0.1, 0.4) * 0.8);
  float far = length(at);
  float side = max(abs(at.x), abs(at.y)) * 0.5 + far * 0.5;
  float shadow = 1.0 - 0.62 * (1.0 - smoothstep(radius * 0.7, radius * 1.25, side));
  vec3 colour = mix(floor_colour, line_colour, lines) * shadow;
  pixel = vec4(mix(colour, far_colour, smoothstep(radius * 1.6, radius * 4.6, far)), 1.0);
}`,
};
