// The little of WebGL 2 that the tray's view stands on: programs, meshes, and meshes drawn many times at once.

/** A program of these two shaders with its uniforms' places. */
export function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`shaders: ${gl.getProgramInfoLog(made)}`);
  }
  const count = gl.isContextLost() ? 0 : gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS);
  const uniforms = {};
  for (let index = 0; index < count; index += 1) {
    const { name } = gl.getActiveUniform(made, index);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { program: made, uniforms };
}

/**
 * Points with the same attributes, drawn as triangles, once or once for each instance.
 *
 * A layout lists [location, count of floats] in the order in which they lie in the buffer.
 */
export class Mesh {
  /** @param {WebGL2RenderingContext} gl @param {[number, number][]} layout @param {[number, number][]} [perInstance] */
  constructor(gl, layout, perInstance = []) {
    this.gl = gl;
    this.floats = floatsOf(layout);
    this.count = 0;
    this.instances = 1;
    this.array = gl.createVertexArray();
    this.buffer = gl.createBuffer();
    gl.bindVertexArray(this.array);
    attach(gl, this.buffer, layout, 0);
    if (perInstance.length > 0) {
      this.instanceFloats = floatsOf(perInstance);
      this.instanceBuffer = gl.createBuffer();
      attach(gl, this.instanceBuffer, perInstance, 1);
    }
    gl.bindVertexArray(null);
  }

  /** Three points for each triangle, to be drawn once or twice. @param {Float32Array} points those before are gone */
  setPoints(points) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, points, this.gl.DYNAMIC_DRAW);
    this.count = points.length / this.floats;
    return this;
  }

  /** Three points for each triangle, to be drawn often: points that are the same are worked out once. */
  setSolid(points) {
    const { gl, floats } = this;
    const known = new Map();
    const [kept, indices] = [[], []];
    for (let at = 0; at < points.length; at += floats) {
      const point = points.subarray(at, at + floats);
      const key = point.join();
      if (!known.has(key)) {
        known.set(key, known.size);
        kept.push(...point);
      }
      indices.push(known.get(key));
    }
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(kept), gl.STATIC_DRAW);
    this.indexBuffer ??= gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indexBuffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(indices), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.count = indices.length;
    return this;
  }

  /** @param {Float32Array} values @param {number} count of instances */
  setInstances(values, count) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.instanceBuffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, values.subarray(0, count * this.instanceFloats), this.gl.DYNAMIC_DRAW);
    this.instances = count;
  }

  draw() {
    if (this.count === 0 || this.instances === 0) {
      return;
    }
    this.gl.bindVertexArray(this.array);
    if (this.indexBuffer) {
      this.gl.drawElementsInstanced(this.gl.TRIANGLES, this.count, this.gl.UNSIGNED_INT, 0, this.instances);
    } else if (this.instanceBuffer) {
      this.gl.drawArraysInstanced(this.gl.TRIANGLES, 0, this.count, this.instances);
    } else {
      this.gl.drawArrays(this.gl.TRIANGLES, 0, this.count);
    }
  }

  delete() {
    this.gl.deleteVertexArray(this.array);
    this.gl.deleteBuffer(this.buffer);
    this.gl.deleteBuffer(this.instanceBuffer ?? null);
    this.gl.deleteBuffer(this.indexBuffer ?? null);
  }
}

const floatsOf = (layout) => layout.reduce((sum, [, count]) => sum + count, 0);

function attach(gl, buffer, layout, divisor) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  let offset = 0;
  for (const [location, count] of layout) {
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, count, gl.FLOAT, false, floatsOf(layout) * 4, offset);
    gl.vertexAttribDivisor(location, divisor);
    offset += count * 4;
  }
}
