// The robot of the report: drag turns it, the wheel zooms; without WebGL the picture below the canvas stays.
(() => {
  const box = document.getElementById('robot-view');
  const source = document.getElementById('robot-data');
  if (!box || !source) return;
  const data = JSON.parse(source.textContent);
  const canvas = box.querySelector('canvas');
  const label = box.querySelector('.mark-label');
  const gl = canvas.getContext('webgl', { antialias: true, alpha: true, preserveDrawingBuffer: true });
  if (!gl) return;

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const whole = new Int16Array(bytes(data.vertices));
  const corners = new Uint32Array(bytes(data.triangles));
  const n = corners.length;
  const positions = new Float32Array(3 * n);
  const normals = new Float32Array(3 * n);
  const colors = new Float32Array(3 * n);
  const at = (k, axis) => data.low[axis] + data.step * whole[3 * k + axis];
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < n; i++)
    for (let axis = 0; axis < 3; axis++) {
      const value = at(corners[i], axis);
      positions[3 * i + axis] = value;
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    }
  for (let i = 0; i < 3 * n; i += 9) {
    const [ux, uy, uz] = [0, 1, 2].map((k) => positions[i + 3 + k] - positions[i + k]);
    const [vx, vy, vz] = [0, 1, 2].map((k) => positions[i + 6 + k] - positions[i + k]);
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const long = Math.hypot(...normal) || 1;
    for (let k = 0; k < 9; k++) normals[i + k] = normal[k % 3] / long;
  }
  let first = 0;
  for (const [count, r, g, b] of data.colors) {
    for (let i = first; i < first + 3 * count; i++) colors.set([r / 255, g / 255, b / 255], 3 * i);
    first += 3 * count;
  }
  const middle = low.map((v, k) => (v + high[k]) / 2);
  const radius = Math.hypot(...low.map((v, k) => high[k] - v)) / 2 || 1;

  const shader = (type, text) => {
    const made = gl.createShader(type);
    gl.shaderSource(made, text);
    gl.compileShader(made);
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(
    program,
    shader(
      gl.VERTEX_SHADER,
      `attribute vec3 position, normal, color; uniform mat4 view; uniform vec3 light; varying vec3 lit;
       void main() { gl_Position = view * vec4(position, 1.0);
         lit = color * (0.45 + 0.55 * abs(dot(normal, light))); }`,
    ),
  );
  gl.attachShader(
    program,
    shader(gl.FRAGMENT_SHADER, 'precision mediump float; varying vec3 lit; void main() { gl_FragColor = vec4(lit, 1.0); }'),
  );
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  for (const [name, values] of [['position', positions], ['normal', normals], ['color', colors]]) {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
  }
  gl.enable(gl.DEPTH_TEST);
  gl.uniform3fv(gl.getUniformLocation(program, 'light'), [0.347, -0.495, 0.793]);
  const place = gl.getUniformLocation(program, 'view');

  // The direction to the eye: azimuth and height in rad. The start is that of the picture.
  const start = { azimuth: Math.atan2(-1.35, 1.0), height: Math.atan2(0.55, Math.hypot(1.0, 1.35)), zoom: 1 };
  // The first view fills the canvas with the corners of the robot's box.
  function fit() {
    const [ca, sa, ch, sh] = [start.azimuth, start.height].flatMap((v) => [Math.cos(v), Math.sin(v)]);
    let most = 1e-9;
    const [w, h] = [canvas.clientWidth || 1, canvas.clientHeight || 1];
    for (let k = 0; k < 8; k++) {
      const p = [0, 1, 2].map((i) => (k & (1 << i) ? high[i] : low[i]) - middle[i]);
      const x = -sa * p[0] + ca * p[1];
      const y = -ca * sh * p[0] - sa * sh * p[1] + ch * p[2];
      most = Math.max(most, Math.abs(x) / Math.max(1, w / h), Math.abs(y) / Math.max(1, h / w));
    }
    return (0.94 * radius) / most;
  }
  let eye = { ...start };
  function draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [w, h] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map((v) => Math.max(1, Math.round(v)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [ca, sa, ch, sh] = [Math.cos(eye.azimuth), Math.sin(eye.azimuth), Math.cos(eye.height), Math.sin(eye.height)];
    const back = [ca * ch, sa * ch, sh];
    const right = [-sa, ca, 0];
    const up = [-ca * sh, -sa * sh, ch];
    const size = radius / eye.zoom;
    const scale = [1 / (size * Math.max(1, w / h)), 1 / (size * Math.max(1, h / w)), -1 / (4 * radius)];
    const rows = [right, up, back].map((axis, k) => axis.map((v) => v * scale[k]));
    const shift = rows.map((row) => -row.reduce((sum, v, k) => sum + v * middle[k], 0));
    const [x, y, z] = rows;
    // prettier-ignore
    const view = [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, ...shift, 1];
    gl.uniformMatrix4fv(place, false, view);
    gl.drawArrays(gl.TRIANGLES, 0, n);
    if (data.mark) {
      const seen = rows.map((row, k) => row.reduce((sum, v, i) => sum + v * data.mark[i], shift[k]));
      label.style.left = `${50 + 50 * seen[0]}%`;
      label.style.top = `${50 - 50 * seen[1]}%`;
      label.hidden = false;
    }
  }
  let held = null;
  canvas.addEventListener('pointerdown', (event) => {
    held = [event.clientX, event.clientY, eye.azimuth, eye.height];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (!held) return;
    eye.azimuth = held[2] - (event.clientX - held[0]) / 120;
    eye.height = Math.max(-1.5, Math.min(1.5, held[3] + (event.clientY - held[1]) / 120));
    draw();
  });
  for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, () => (held = null));
  canvas.addEventListener(
    'wheel',
    (event) => {
      eye.zoom = Math.max(0.5, Math.min(12, eye.zoom * Math.exp(-event.deltaY / 500)));
      event.preventDefault();
      draw();
    },
    { passive: false },
  );
  canvas.addEventListener('keydown', (event) => {
    const turn = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.15], ArrowDown: [0, -0.15] }[event.key];
    if (turn) {
      eye.azimuth += turn[0];
      eye.height = Math.max(-1.5, Math.min(1.5, eye.height + turn[1]));
    } else if (event.key === '+' || event.key === '-') eye.zoom *= event.key === '+' ? 1.2 : 1 / 1.2;
    else return;
    event.preventDefault();
    draw();
  });
  canvas.addEventListener('dblclick', () => {
    eye = { ...start };
    draw();
  });
  box.classList.add('live');
  eye.zoom = start.zoom = fit(); // the canvas has its size only now
  new ResizeObserver(draw).observe(canvas);
  draw();
})();
