// Draws the tray with WebGL: the platen, the courier with its tray, parts, marks on them, trails, and the stations' tools.
//
// Everything is drawn as seen from the tray's centre, so that the picture stands while the courier travels.

import { Mesh, program } from "./gl.js";
import { lookAt, multiply, perspective, project, quatAbout, quatMultiply } from "./mat4.js";
import { AT, LIT, MARK, PLATEN, TRAIL } from "./shaders.js";
import { courierPoints, glassPoints, toolPoints, trayPoints } from "./tray_mesh.js";
import { light, shade } from "./theme.js";

/**
 * A part or a tool: `place` and `turn` in the tray's frame.
 * @typedef {{pose: number, place: [number, number, number], turn: number[], tint: number[]}} Body
 * A mark on the tray's surface; see the shader for its looks.
 * @typedef {{place: [number, number, number], turn: number[], size: number, look: number, tint: number[]}} Mark
 * @typedef {{centre: [number, number], yaw: number, bodies: Body[], shadows: Mark[], marks: Mark[], trails: Float32Array,
 *   tools: {place: [number, number, number], yaw: number}[]}} Picture
 */

const Z = [0, 0, 1];
const FOV_RAD = 0.62;
/** Half the side of the platen that is drawn, m. */
const FLOOR_M = 2;
const BODY_LAYOUT = [[AT.place, 3], [AT.normal, 3], [AT.material, 1], [AT.shade, 1]];
const BODY_INSTANCE = [[AT.offset, 3], [AT.turn, 4], [AT.tint, 4]];
const MARK_INSTANCE = [...BODY_INSTANCE, [AT.look, 2]];
/** Palette in the order of MATERIAL. */
const PALETTE = ["ramp", "plateau", "wall", "hub", "drop", "courier", "mark", "tool"];
const SQUARE = new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0]);

export class Scene {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.isSoftware = drawsInSoftware();
    this.gl = canvas.getContext("webgl2", { antialias: !this.isSoftware, alpha: false });
    if (!this.gl) {
      throw new Error("this browser shows no WebGL 2");
    }
    this.buffer = new Float32Array(0);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.#build());
    this.tray = null;
    this.parts = { fine: [], coarse: [] };
    this.#build();
  }

  /** Makes everything that lives in the graphics memory; again, when that was lost. */
  #build() {
    const { gl } = this;
    this.lit = program(gl, LIT.vertex, LIT.fragment);
    this.mark = program(gl, MARK.vertex, MARK.fragment);
    this.trail = program(gl, TRAIL.vertex, TRAIL.fragment);
    this.platen = program(gl, PLATEN.vertex, PLATEN.fragment);
    this.floorMesh = new Mesh(gl, [[AT.place, 3]]).setPoints(SQUARE.map((value) => value * FLOOR_M));
    this.markMesh = new Mesh(gl, [[AT.place, 3]], MARK_INSTANCE).setPoints(SQUARE);
    this.trailMesh = new Mesh(gl, [[AT.place, 3], [AT.colour, 4]]);
    this.toolMesh = new Mesh(gl, BODY_LAYOUT, BODY_INSTANCE).setSolid(toolPoints());
    this.trayMesh = new Mesh(gl, BODY_LAYOUT, BODY_INSTANCE);
    this.glassMesh = new Mesh(gl, BODY_LAYOUT, BODY_INSTANCE);
    this.courierMesh = new Mesh(gl, BODY_LAYOUT, BODY_INSTANCE);
    this.partMeshes = { fine: [], coarse: [] };
    if (this.tray) {
      this.setTray(this.tray, this.radius);
    }
    this.setParts(this.parts);
  }

  /** @param {any} tray geometry @param {number} radius of a disc that covers courier and tray, m */
  setTray(tray, radius) {
    this.tray = tray;
    this.radius = radius;
    this.trayMesh.setSolid(trayPoints(tray));
    this.glassMesh.setSolid(glassPoints(tray));
    this.courierMesh.setSolid(courierPoints(radius, tray.floor_height_m));
  }

  /** @param {{fine: Float32Array[], coarse: Float32Array[]}} parts the points of a part, one for each resting pose */
  setParts(parts) {
    this.parts = parts;
    Object.values(this.partMeshes).flat().forEach((mesh) => mesh.delete());
    const meshes = (each) => each.map((points) => new Mesh(this.gl, BODY_LAYOUT, BODY_INSTANCE).setSolid(points));
    this.partMeshes = { fine: meshes(parts.fine), coarse: meshes(parts.coarse) };
  }

  /**
   * Fits the picture to its place on the screen.
   * @param {number} width CSS pixels @param {number} height @param {number} quality share of the screen's own pixels
   */
  fit(width, height, quality) {
    const scale = Math.min(2, devicePixelRatio || 1) * quality;
    const [w, h] = [Math.max(2, Math.round(width * scale)), Math.max(2, Math.round(height * scale))];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
  }

  /** Looks from here. A narrow picture is looked at from further away. @param {[number, number, number]} eye */
  look(eye) {
    const { width, height } = this.canvas;
    const aspect = width / height;
    const back = aspect < 1.25 ? 1.25 / aspect : 1;
    const target = [0, 0, (this.tray?.rise_m ?? 0) * 0.3];
    this.eye = eye.map((value, axis) => value * back + target[axis]);
    // Straight from above "up" is where the eye came from.
    const up = Math.hypot(eye[0], eye[1]) < 0.02 * eye[2] ? [-eye[0], -eye[1], 0] : Z;
    this.camera = multiply(perspective(FOV_RAD, aspect, 0.02, 4), lookAt(this.eye, target, up));
  }

  /** Where a place in the tray's frame appears, as shares of the picture. @param {number} yaw of the tray */
  onScreen(place, yaw) {
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const at = project(this.camera, [place[0] * c - place[1] * s, place[0] * s + place[1] * c, place[2]]);
    return at && [0.5 + at[0] / 2, 0.5 - at[1] / 2];
  }

  /** @param {Picture} picture @param {boolean} isCoarse parts are drawn as their outlines, raised */
  draw(picture, isCoarse) {
    const { gl } = this;
    if (!this.tray || gl.isContextLost()) {
      return;
    }
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    this.#drawPlaten(picture);
    this.#drawBodies(picture, isCoarse ? this.partMeshes.coarse : this.partMeshes.fine);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    this.#drawMarks(picture.shadows, picture.yaw);
    this.#drawTrails(picture);
    this.#drawMarks(picture.marks, picture.yaw);
    this.#drawGlass(picture);
    gl.depthMask(true);
    gl.bindVertexArray(null);
  }

  #drawPlaten({ centre }) {
    const { gl } = this;
    const { program: made, uniforms } = this.platen;
    gl.useProgram(made);
    gl.uniformMatrix4fv(uniforms.camera, false, this.camera);
    gl.uniform1f(uniforms.level, -this.tray.floor_height_m);
    gl.uniform2f(uniforms.centre, ...centre);
    gl.uniform1f(uniforms.radius, this.radius);
    gl.uniform3f(uniforms.floor_colour, ...shade("floor"));
    gl.uniform3f(uniforms.line_colour, ...shade("floor-line"));
    gl.uniform3f(uniforms.far_colour, ...shade("floor-far"));
    const far = shade("floor-far");
    gl.clearColor(far[0], far[1], far[2], 1);
    this.floorMesh.draw();
  }

  #drawBodies(picture, partMeshes) {
    const { gl } = this;
    const { program: made, uniforms } = this.lit;
    gl.useProgram(made);
    gl.uniformMatrix4fv(uniforms.camera, false, this.camera);
    gl.uniform3f(uniforms.eye, ...this.eye);
    gl.uniform3f(uniforms.sky, ...light("sky"));
    gl.uniform3f(uniforms.ground, ...light("ground"));
    gl.uniform3fv(uniforms["palette[0]"], PALETTE.flatMap((name) => light(name)));
    const turn = quatAbout(Z, picture.yaw);
    const carried = [[0, 0, 0, ...turn, 0, 0, 0, 0]];
    gl.uniform1f(uniforms.opacity, 1);
    gl.uniform1f(uniforms.gloss, 0.16);
    this.#drawEach(this.trayMesh, carried);
    this.#drawEach(this.courierMesh, carried);
    gl.uniform1f(uniforms.gloss, 0.3);
    this.#drawEach(this.toolMesh, picture.tools.map((tool) => [...tool.place, ...quatAbout(Z, tool.yaw), 0, 0, 0, 0]));
    gl.uniform1f(uniforms.gloss, 0.22);
    partMeshes.forEach((mesh, pose) => {
      const lying = picture.bodies.filter((body) => body.pose === pose);
      this.#drawEach(mesh, lying.map((body) => [...turned(turn, body.place), ...quatMultiply(turn, body.turn), ...body.tint]));
    });
  }

  #drawGlass(picture) {
    const { gl } = this;
    gl.useProgram(this.lit.program);
    gl.uniform1f(this.lit.uniforms.opacity, 0.13);
    gl.uniform1f(this.lit.uniforms.gloss, 0.5);
    this.#drawEach(this.glassMesh, [[0, 0, 0, ...quatAbout(Z, picture.yaw), 0, 0, 0, 0]]);
  }

  #drawMarks(marks, yaw) {
    const { gl } = this;
    const turn = quatAbout(Z, yaw);
    gl.useProgram(this.mark.program);
    gl.uniformMatrix4fv(this.mark.uniforms.camera, false, this.camera);
    this.#drawEach(this.markMesh, marks.map((mark) =>
      [...turned(turn, mark.place), ...quatMultiply(turn, mark.turn), ...mark.tint, mark.size, mark.look]));
  }

  #drawTrails({ trails, yaw }) {
    const { gl } = this;
    if (trails.length === 0) {
      return;
    }
    gl.useProgram(this.trail.program);
    gl.uniformMatrix4fv(this.trail.uniforms.camera, false, this.camera);
    gl.uniform4f(this.trail.uniforms.turn, ...quatAbout(Z, yaw));
    gl.uniform3f(this.trail.uniforms.offset, 0, 0, 0);
    this.trailMesh.setPoints(trails).draw();
  }

  /** Draws a mesh once for each row of values. @param {Mesh} mesh @param {number[][]} rows */
  #drawEach(mesh, rows) {
    const wanted = rows.length * mesh.instanceFloats;
    if (this.buffer.length < wanted) {
      this.buffer = new Float32Array(wanted * 2);
    }
    rows.forEach((row, index) => this.buffer.set(row, index * mesh.instanceFloats));
    mesh.setInstances(this.buffer, rows.length);
    mesh.draw();
  }
}

/** Whether WebGL runs on the processor: smooth edges would double its work. */
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

/** A vector turned about z. */
function turned([, , z, w], place) {
  const [c, s] = [w * w - z * z, 2 * w * z];
  return [place[0] * c - place[1] * s, place[0] * s + place[1] * c, place[2]];
}
