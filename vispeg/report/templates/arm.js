"use strict";
// The arm in 3D, by WebGL: as measured, and as models predict it, with their error enlarged, at the charts' cursor.
for (const root of document.querySelectorAll("[data-traces]")) {
  const stage = root.querySelector("[data-stage]");
  if (stage) armStage(root, stage);
}

function armStage(root, stage) {
  const canvas = stage.querySelector("canvas"), gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return; // without WebGL, only the charts are shown
  const arm = JSON.parse(stage.querySelector("[data-arm]").textContent), one = (name) => stage.querySelector(`[data-${name}]`);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const eye = { turn: 0.9, tip: 0.25, far: 0, target: [0, 0, 0] };
  let track = 0, time = 0, playing = 0;
  stage.hidden = false;

  const program = link(`#version 300 es
    in vec3 at; in vec3 colour; uniform mat4 view, body; uniform float scale; out vec3 place, tint;
    void main() { vec4 p = body * vec4(at * scale, 1.0); place = p.xyz; tint = colour; gl_Position = view * p; }`, `#version 300 es
    precision highp float; in vec3 place, tint; uniform vec4 ghost; uniform vec3 eye; out vec4 shade;
    void main() {
      vec3 n = normalize(cross(dFdx(place), dFdy(place))), to = normalize(eye - place);
      float light = 0.35 + 0.65 * abs(dot(n, to)) * (0.75 + 0.25 * n.z);
      shade = ghost.a > 0.0 ? vec4(ghost.rgb * light, 1.0) * ghost.a : vec4(tint * light, 1.0);
    }`);
  const where = (name) => gl.getUniformLocation(program, name);
  const at = Object.fromEntries(["view", "body", "scale", "ghost", "eye"].map((name) => [name, where(name)]));
  attribute("at", new Int16Array(bytes(arm.vertex).buffer), gl.SHORT, false);
  attribute("colour", bytes(arm.colour), gl.UNSIGNED_BYTE, true);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(bytes(arm.face).buffer), gl.STATIC_DRAW);

  root.addEventListener("moment", (e) => { track = e.detail.track; time = e.detail.time; draw(); });
  root.addEventListener("track", (e) => { track = e.detail.track; time = arm.worst[track].time; draw(); });
  one("worst").addEventListener("click", () => root.dispatchEvent(new CustomEvent("go", { detail: { track, time: arm.worst[track].time } })));
  one("play").addEventListener("click", play);
  for (const input of stage.querySelectorAll("input")) input.addEventListener("input", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  new ResizeObserver(draw).observe(canvas);
  turning();
  ({ track, time } = arm.first);
  frame(root.tracks[track]);
  root.posed = (q) => posed(q).map((m) => [m[12], m[13], m[14]]);
  draw();
  root.dispatchEvent(new CustomEvent("go", { detail: arm.first }));

  function draw() {
    const ratio = Math.min(devicePixelRatio || 1, 2), width = canvas.clientWidth * ratio, height = canvas.clientHeight * ratio;
    if (!width) return;
    if (canvas.width !== Math.round(width)) Object.assign(canvas, { width: Math.round(width), height: Math.round(height) });
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(program);
    const from = position();
    gl.uniformMatrix4fv(at.view, false, times(perspective(canvas.width / canvas.height), look(from, eye.target)));
    gl.uniform3fv(at.eye, from);
    gl.uniform1f(at.scale, arm.scale);
    const now = root.tracks[track], k = nearest(now.time, time), enlarged = +one("times")?.value; // no slider, no model to draw
    if (enlarged) one("factor").textContent = enlarged + " ×";
    const measured = angles(now, k);
    gl.disable(gl.BLEND);
    shape(measured, [0, 0, 0, 0]);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const box of stage.querySelectorAll("[data-ghost]")) {
      const left = now.arrays[box.dataset.ghost];
      if (!box.checked || !left) continue;
      const css = getComputedStyle(document.documentElement).getPropertyValue("--" + box.dataset.ghost).trim();
      const rgb = [1, 3, 5].map((i) => parseInt(css.slice(i, i + 2), 16) / 255);
      shape(measured.map((v, j) => v - enlarged * (left[j][k] || 0)), [...rgb, 0.5]);
    }
    one("where").textContent = `${now.name}, ${now.time[k].toFixed(2)} s`;
  }

  function shape(q, ghost) {
    const matrices = posed(q);
    gl.uniform4fv(at.ghost, ghost);
    gl[ghost[3] ? "enable" : "disable"](gl.POLYGON_OFFSET_FILL); // where both coincide, the measured arm is drawn
    gl.polygonOffset(2, 2);
    for (const pass of ghost[3] ? ["depth", "colour"] : ["colour"]) { // of a transparent arm, only the nearest surface
      gl.colorMask(pass === "colour", pass === "colour", pass === "colour", pass === "colour");
      gl.depthFunc(gl.LEQUAL);
      for (const [body, first, count] of arm.parts) {
        gl.uniformMatrix4fv(at.body, false, matrices[body]);
        gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_SHORT, 6 * first);
      }
    }
  }

  function angles(now, k) {
    const of = now.arrays.posture || now.arrays.measured;
    return of.map((row) => { for (let i = k; i >= 0; i--) if (row[i] != null) return row[i]; return 0; });
  }

  function posed(q) { // each body's pose in the base frame, column-major
    const matrices = [];
    arm.bodies.forEach((body, b) => {
      let m = rigid(body.quat, body.pos);
      if (b) m = times(matrices[body.parent], m);
      for (const joint of arm.joints) if (joint.body === b) {
        const half = (q[joint.at] - joint.zero) / 2, s = Math.sin(half), [x, y, z] = joint.axis, c = joint.anchor;
        const turn = rigid([Math.cos(half), s * x, s * y, s * z], c);
        m = times(m, times(turn, rigid([1, 0, 0, 0], c.map((v) => -v))));
      }
      matrices.push(m);
    });
    return matrices;
  }

  function play() {
    playing = playing ? 0 : performance.now();
    one("play").textContent = playing ? "Pause" : "Play";
    let before = playing;
    const step = (now) => {
      if (!playing) return;
      const ends = root.tracks[track].time, last = ends[ends.length - 1];
      const later = time + (now - before) / 1000;
      before = now;
      time = later > last ? ends[0] : later;
      draw();
      requestAnimationFrame(step);
    };
    if (playing) requestAnimationFrame(step);
  }

  function turning() { // the view turns and zooms by dragging, keys, two fingers, or Ctrl and the wheel
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (e) => { fingers.set(e.pointerId, e); canvas.setPointerCapture(e.pointerId); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      const was = fingers.get(e.pointerId);
      if (!was) return;
      const other = [...fingers.values()].find((f) => f.pointerId !== e.pointerId);
      if (other) eye.far *= Math.hypot(was.x - other.x, was.y - other.y) / Math.max(1, Math.hypot(e.x - other.x, e.y - other.y));
      else orbit((was.x - e.x) / 150, (e.y - was.y) / 150);
      fingers.set(e.pointerId, e);
      orbit(0, 0);
    });
    canvas.addEventListener("wheel", (e) => { if (e.ctrlKey) { e.preventDefault(); eye.far *= Math.exp(e.deltaY / 300); orbit(0, 0); } }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const turn = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1.1] }[e.key];
      if (!turn) return;
      e.preventDefault();
      eye.far *= turn[2] || 1;
      orbit(turn[0], turn[1]);
    });
  }

  function orbit(turn, tip) {
    eye.turn += turn;
    eye.tip = Math.min(1.5, Math.max(-0.5, eye.tip + tip));
    eye.far = Math.min(20, Math.max(0.3, eye.far));
    draw();
  }

  function frame(now) { // fit the whole motion into the view
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let k = 0; k < now.time.length; k += Math.ceil(now.time.length / 40)) for (const m of posed(angles(now, k))) {
      for (let i = 0; i < 3; i++) { low[i] = Math.min(low[i], m[12 + i]); high[i] = Math.max(high[i], m[12 + i]); }
    }
    eye.target = low.map((v, i) => (v + high[i]) / 2);
    eye.far = 1.6 * Math.hypot(...low.map((v, i) => high[i] - v)) + 0.2;
  }

  function position() {
    const { turn, tip, far, target } = eye;
    return [target[0] + far * Math.cos(tip) * Math.cos(turn), target[1] + far * Math.cos(tip) * Math.sin(turn), target[2] + far * Math.sin(tip)];
  }

  function nearest(sorted, t) {
    let low = 0, high = sorted.length - 1;
    while (high - low > 1) { const k = (low + high) >> 1; if (sorted[k] <= t) low = k; else high = k; }
    return t - sorted[low] <= sorted[high] - t ? low : high;
  }

  function attribute(name, values, type, normalized) {
    const index = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, 3, type, normalized, 0, 0);
  }

  function link(...sources) {
    const made = gl.createProgram();
    sources.forEach((source, i) => {
      const part = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(part, source.trim());
      gl.compileShader(part);
      gl.attachShader(made, part);
    });
    gl.linkProgram(made);
    return made;
  }

  function rigid([w, x, y, z], [a, b, c]) {
    return [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
      2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
      2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0, a, b, c, 1];
  }

  function times(a, b) {
    const out = new Array(16).fill(0);
    for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) for (let k = 0; k < 4; k++) out[4 * j + i] += a[4 * k + i] * b[4 * j + k];
    return out;
  }

  function perspective(aspect) {
    const f = 1 / Math.tan(0.35), near = 0.05, far = 50;
    return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
  }

  function look(from, to) {
    const unit = (v) => { const n = Math.hypot(...v); return v.map((x) => x / n); };
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const z = unit(from.map((v, i) => v - to[i])), x = unit(cross([0, 0, 1], z)), y = cross(z, x);
    return [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, from), -dot(y, from), -dot(z, from), 1];
  }
}
