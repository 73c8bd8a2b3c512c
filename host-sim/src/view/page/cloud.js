// The cloud of points, to turn: plain WebGL.

import { colourOf } from "./pictures.js";

const VERTEX = `
  attribute vec3 place;
  attribute vec4 colour;
  uniform mat4 view;
  uniform float size;
  varying vec4 shade;
  void main() {
    gl_Position = view * vec4(place, 1.0);
    gl_PointSize = clamp(size / gl_Position.w, 1.0, 12.0);
    shade = colour;
  }`;
const FRAGMENT = `
  precision mediump float;
  varying vec4 shade;
  void main() { gl_FragColor = shade; }`;

const START = { yaw: 0.35, pitch: 0.2, distance: 0.75 };

// The points of a frame: places in m, right, up and away from the viewer negative, with colours of the
// left view or else of the depth.
export function pointsOf(frame, camera) {
  const { depths } = frame.planes;
  const picture = frame.planes.rectified_left ?? frame.planes.raw_left;
  const isPicture = picture && picture.width >= depths.x + depths.width && picture.height >= depths.y + depths.height;
  const places = [];
  const colours = [];
  const [cx, cy] = camera.principal_px;
  const [near, far] = rangeOf(depths);
  for (let row = 0, i = 0; row < depths.height; row++) {
    for (let column = 0; column < depths.width; column++, i++) {
      const mm = depths.values[i];
      if (mm === 0 || mm > far * 1.5) continue;
      const z = mm / 1000;
      const x = column + depths.x;
      const y = row + depths.y;
      places.push(((x - cx) * z) / camera.focal_px, (-(y - cy) * z) / camera.focal_px, -z);
      if (isPicture) {
        const at = (y * picture.width + x) * picture.channels;
        for (let c = 0; c < 3; c++) colours.push(picture.values[at + (picture.channels === 3 ? c : 0)]);
      } else {
        const pixel = colourOf(1 / mm, 1 / far, 1 / near);
        colours.push(pixel & 255, (pixel >> 8) & 255, (pixel >> 16) & 255);
      }
      colours.push(255);
    }
  }
  return { places: new Float32Array(places), colours: new Uint8Array(colours), middle: (near + far) / 2000 };
}

// Depths, mm, that all but the nearest and the farthest 2 % of the pixels have; [0, 0] without any.
export function rangeOf(depths) {
  const known = depths.values.filter((mm) => mm > 0).sort();
  const at = (part) => known[Math.floor(part * (known.length - 1))] ?? 0;
  return [at(0.02), at(0.98)];
}

// A view of a cloud on a canvas, which `handle`, the element above it, turns.
export class Cloud {
  constructor(canvas, handle) {
    this.canvas = canvas;
    this.turn = { ...START };
    this.cloud = { places: new Float32Array(), colours: new Uint8Array(), middle: 1 };
    this.gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
    if (this.gl) this.#prepare();
    this.#listen(handle);
  }

  show(cloud) {
    const { gl } = this;
    const isFirst = this.cloud.places.length === 0;
    // The point that the view turns around stays, so that a still scene does not sway.
    if (!isFirst) cloud.middle = this.cloud.middle;
    this.cloud = cloud;
    if (!gl) return;
    for (const [buffer, values] of [[this.places, cloud.places], [this.colours, cloud.colours]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    }
    this.draw();
  }

  reset() {
    this.turn = { ...START };
    this.draw();
  }

  #prepare() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    this.program = program;
    this.places = gl.createBuffer();
    this.colours = gl.createBuffer();
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.04, 0.05, 0.06, 1);
    for (const [name, buffer, size, type, isNormal] of [
      ["place", this.places, 3, gl.FLOAT, false],
      ["colour", this.colours, 4, gl.UNSIGNED_BYTE, true],
    ]) {
      const at = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, isNormal, 0, 0);
    }
  }

  draw() {
    const { gl, canvas } = this;
    if (!gl) return;
    const width = Math.round(canvas.clientWidth * devicePixelRatio);
    const height = Math.round(width * 0.75);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "view"), false, this.#matrix(width / height));
    gl.uniform1f(gl.getUniformLocation(this.program, "size"), (height / 260) * this.cloud.middle);
    gl.drawArrays(gl.POINTS, 0, this.cloud.places.length / 3);
  }

  // From the cloud to the screen, column by column: around its middle, away from the viewer, in perspective.
  #matrix(aspect) {
    const { yaw, pitch, distance } = this.turn;
    const { middle } = this.cloud;
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    const away = middle * distance;
    const [near, far] = [away / 100, away * 30];
    const scale = 1.6;
    // Rows of the rotation; the middle of the cloud is at z = -middle.
    const rows = [[cy, 0, -sy], [sp * sy, cp, sp * cy], [cp * sy, -sp, cp * cy]];
    const moved = rows.map((row, i) => [...row, row[2] * middle - (i === 2 ? away : 0)]);
    const a = (far + near) / (near - far);
    const b = (2 * far * near) / (near - far);
    const matrix = [];
    for (let column = 0; column < 4; column++) {
      const [x, y, z] = moved.map((row) => row[column]);
      matrix.push((x * scale) / aspect, y * scale, a * z + (column === 3 ? b : 0), -z);
    }
    return matrix;
  }

  #listen(handle) {
    const fingers = new Map();
    const spread = () => {
      const [a, b] = [...fingers.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    const zoom = (factor) => {
      this.turn.distance = Math.min(5, Math.max(0.1, this.turn.distance * factor));
      this.draw();
    };
    const rotate = (yaw, pitch) => {
      this.turn.yaw += yaw;
      this.turn.pitch = Math.min(1.5, Math.max(-1.5, this.turn.pitch + pitch));
      this.draw();
    };
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    handle.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const wide = fingers.size === 2 ? spread() : 0;
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 2) zoom(wide / (spread() || 1));
      else rotate((event.clientX - before.x) / 150, (event.clientY - before.y) / 150);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      handle.addEventListener(end, (event) => fingers.delete(event.pointerId));
    }
    handle.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(Math.exp(event.deltaY / 600));
    }, { passive: false });
    handle.addEventListener("dblclick", () => this.reset());
    handle.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (turns[event.key]) rotate(...turns[event.key]);
      else if (event.key === "+") zoom(0.9);
      else if (event.key === "-") zoom(1.1);
      else if (event.key === "Home") this.reset();
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }
}
