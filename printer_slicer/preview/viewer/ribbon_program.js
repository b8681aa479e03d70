/**
 * The WebGL program that draws each move as a ribbon with a top and two sides.
 */

const VERTICES_PER_RIBBON = 8; // a strip of three quads

const VERTEX_SHADER = `#version 300 es
precision highp float;
precision highp int;
layout(location = 0) in vec3 begin;  // steps
layout(location = 1) in vec3 end;
layout(location = 2) in vec2 size;   // 0.005 mm, 0.001 mm
layout(location = 3) in float colour;
uniform mat4 toPicture;
uniform vec3 origin;
uniform vec3 stepLength;
uniform vec2 light;                  // direction to the light, across the bed
uniform float layers;                // height of a ribbon in layers
uniform bool travels;
uniform sampler2D palette;
out vec3 lit;

void main() {
  int index = int(colour);
  bool isTravel = index == 1;
  if (index < 4 && !(isTravel && travels)) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  vec3 from = origin + stepLength * begin;
  vec3 to = origin + stepLength * end;
  vec2 way = to.xy - from.xy;
  vec2 along = length(way) > 0.0 ? normalize(way) : vec2(1.0, 0.0);
  vec2 left = vec2(-along.y, along.x);
  float width = isTravel ? 0.1 : 0.005 * size.x;
  float height = isTravel ? 0.1 : layers * 0.001 * size.y;
  int row = gl_VertexID / 2;
  float side = row < 2 ? 1.0 : -1.0;
  bool isTop = row == 1 || row == 2;
  bool atEnd = (gl_VertexID & 1) == 1;
  vec3 place = atEnd ? to : from;
  place.xy += (atEnd ? 0.25 : -0.25) * width * along + side * (isTop ? 0.3 : 0.5) * width * left;
  place.z -= isTop ? 0.0 : height;
  gl_Position = toPicture * vec4(place, 1.0);
  float brightness = isTop ? 1.0 : 0.6 + 0.25 * dot(side * left, light);
  lit = brightness * texelFetch(palette, ivec2(index, 0), 0).rgb;
}`;

const FRAGMENT_SHADER = `#version 300 es
precision mediump float;
in vec3 lit;
out vec4 colour;
void main() { colour = vec4(lit, 1.0); }`;

/**
 * Columns of moves in the memory of the graphics processor.
 *
 * @typedef {Object} RibbonColumns
 * @property {WebGLBuffer} begin start of each move
 * @property {WebGLBuffer} end end of each move
 * @property {number} endOffset bytes before the first end
 * @property {WebGLBuffer} size
 * @property {WebGLBuffer} colour
 */

/** Draws ranges of moves as ribbons. */
export class RibbonProgram {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./preview.js").Preview} preview
   */
  constructor(gl, preview) {
    this.gl = gl;
    this.program = linkProgram(gl);
    this.uniforms = Object.fromEntries(
      ["toPicture", "origin", "stepLength", "light", "layers", "travels"].map((name) => [
        name,
        gl.getUniformLocation(this.program, name),
      ]),
    );
    gl.useProgram(this.program);
    gl.uniform3fv(this.uniforms.origin, preview.origin);
    gl.uniform3fv(this.uniforms.stepLength, preview.step);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    for (let place = 0; place < 4; place += 1) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribDivisor(place, 1);
    }
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  /**
   * Put a column into the memory of the graphics processor.
   *
   * @param {Uint16Array | Uint8Array} values
   * @returns {WebGLBuffer}
   */
  upload(values) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return buffer;
  }

  /** @param {string[]} palette "#rrggbb" */
  setPalette(palette) {
    const { gl } = this;
    const texels = new Uint8Array(4 * 256);
    palette.slice(0, 256).forEach((colour, index) => {
      const number = Number.parseInt(colour.slice(1), 16);
      texels.set([number >> 16, (number >> 8) & 255, number & 255, 255], 4 * index);
    });
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
  }

  /**
   * Set from where the print is seen.
   *
   * @param {import("./orbit_camera.js").OrbitCamera} camera
   * @param {boolean} travels whether travels are drawn
   */
  look(camera, travels) {
    const { gl, uniforms } = this;
    const angle = camera.yaw - 0.7; // the light comes from the left of the camera
    gl.uniformMatrix4fv(uniforms.toPicture, false, camera.matrix());
    gl.uniform2f(uniforms.light, Math.sin(angle), -Math.cos(angle));
    gl.uniform1i(uniforms.travels, travels ? 1 : 0);
  }

  /**
   * Draw moves.
   *
   * @param {RibbonColumns} columns
   * @param {number} first
   * @param {number} count
   * @param {number} layers height of each ribbon in layers
   */
  draw(columns, first, count, layers) {
    if (count <= 0) return;
    const { gl } = this;
    const point = (place, buffer, length, type, bytes, offset) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.vertexAttribPointer(place, length, type, false, 0, offset + bytes * first);
    };
    point(0, columns.begin, 3, gl.UNSIGNED_SHORT, 6, 0);
    point(1, columns.end, 3, gl.UNSIGNED_SHORT, 6, columns.endOffset);
    point(2, columns.size, 2, gl.UNSIGNED_SHORT, 4, 0);
    point(3, columns.colour, 1, gl.UNSIGNED_BYTE, 1, 0);
    gl.uniform1f(this.uniforms.layers, layers);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, VERTICES_PER_RIBBON, count);
  }
}

/** @param {WebGL2RenderingContext} gl */
function linkProgram(gl) {
  const program = gl.createProgram();
  for (const { kind, source } of [
    { kind: gl.VERTEX_SHADER, source: VERTEX_SHADER },
    { kind: gl.FRAGMENT_SHADER, source: FRAGMENT_SHADER },
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`WebGL: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}
