// Added to the page of viser: view cube, fit, measure, names of links, copies and links of the posture, dark page,
// fewer pixels on slow graphics. viser's page keeps its scene and its camera in window.__viserMutable.
(function strip() {
  // viser opens its connection at the address of the page, which must have no fragment
  if (!location.hash.startsWith('#q=')) return;
  window.twinLink = decodeURIComponent(location.hash.slice(1));
  history.replaceState(null, '', location.pathname + location.search);
})();
(function begin(tries = 600) {
  const viser = window.__viserMutable;
  if (!viser) {
    if (tries > 0) setTimeout(begin, 100, tries - 1); // viser's own script begins later
    return;
  }
  const MESH = /^\/([^/]+)\/([^/]+)\/mesh\d+$/;
  const OTHER = /^(ghost_|light|WorldAxes|floor|tool)/;
  const thing = window.twinContent === 'faces' ? 'drawing' : 'robot';
  const ready = () => viser.scene && viser.camera && viser.cameraControl && viser.canvas;
  const style = document.createElement('style');
  style.textContent = `
    .twin-bar { display: inline-flex; gap: 2px; } .twin-bar button { padding: 0 10px; border-radius: 10px; }
    .twin-bar button[aria-pressed="true"] { background: #1b57aa; color: #fff; }
    .twin-help { display: flex; align-items: center; max-width: calc(100vw - 16px); }
    :root[data-mantine-color-scheme="dark"] :is(.twin-help, .twin-help button, .twin-keys) { background-color: #1b232d; color: #e6ebf1; border-color: #3a4653; }
    :root[data-mantine-color-scheme="dark"] .twin-room { background-color: #161c23 !important; }
    :root[data-mantine-color-scheme="dark"] .twin-bar button[aria-pressed="true"] { background: #2f74d0; }
    .twin-cube { position: fixed; z-index: 890; width: 96px; height: 96px; pointer-events: none; }
    .twin-cube button { position: absolute; left: 22px; top: 22px; width: 52px; height: 52px; padding: 0; font: 600 12px system-ui, sans-serif; color: #17212e; background: #eef3fae8; border: 1px solid #8898aa; pointer-events: auto; cursor: pointer; transform-origin: 50% 50%; }
    @media (pointer: coarse) { .twin-cube { width: 132px; height: 132px; } .twin-cube button { left: 28px; top: 28px; width: 76px; height: 76px; } }
    .twin-cube button:hover { background: #cfe0f7; }
    .twin-name { position: fixed; z-index: 890; padding: 2px 8px; border-radius: 8px; background: #17212ee8; color: #fff; font: 14px system-ui, sans-serif; pointer-events: none; }
    .twin-measure { position: fixed; z-index: 880; left: 0; top: 0; width: 100vw; height: 100vh; pointer-events: none; }
    .twin-measure text { font: 600 15px system-ui, sans-serif; fill: #17212e; stroke: #fff; stroke-width: 4px; paint-order: stroke; }
    .twin-said { position: fixed; z-index: 901; left: 50%; bottom: 74px; transform: translateX(-50%); padding: 6px 14px; border-radius: 12px; background: #17212e; color: #fff; font: 14px system-ui, sans-serif; }
    .twin-name[hidden], .twin-said[hidden], .twin-cube[hidden], .twin-measure[hidden] { display: none; }
    .twin-help.narrow { font-size: 0; padding-left: 4px; } .twin-help.narrow button { font-size: 14px; }
    @media (max-width: 640px) { .twin-last { padding-bottom: 72px !important; } } /* the bar is below it */
    @media print { .twin-cube, .twin-measure { display: none; } }`;
  document.head.append(style);

  const make = (tag, name, parent = document.body) => {
    const node = document.createElement(tag);
    node.className = name;
    parent.append(node);
    return node;
  };
  const draw = () => viser.requestRender?.();

  // -- the links of the robots --------------------------------------------------------------------------
  /** Return the drawn meshes as [{mesh, robot, link}]. */
  function meshes() {
    const found = [];
    for (const [path, node] of Object.entries(viser.nodeRefFromName)) {
      const match = MESH.exec(path);
      if (!match || !node || OTHER.test(match[1])) continue;
      node.traverseVisible((part) => part.isMesh && found.push({ mesh: part, robot: match[1], link: match[2] }));
    }
    return found.filter(({ mesh }) => shown(mesh));
  }
  function shown(part) {
    for (let at = part; at; at = at.parent) if (!at.visible) return false;
    return true;
  }
  function vector(x = 0, y = 0, z = 0) {
    return viser.camera.position.clone().set(x, y, z);
  }
  /** Return the nearest link at a point of the page: {robot, link, mesh, point in the scene}; null: none. */
  function pick(x, y) {
    const box = viser.canvas.getBoundingClientRect();
    if (x < box.left || x > box.right || y < box.top || y > box.bottom) return null;
    const origin = vector().setFromMatrixPosition(viser.camera.matrixWorld);
    const through = vector(((x - box.left) / box.width) * 2 - 1, 1 - ((y - box.top) / box.height) * 2, 0.5);
    const direction = through.unproject(viser.camera).sub(origin).normalize();
    const caster = { ray: { origin, direction }, near: 0, far: Infinity, camera: viser.camera, params: { Mesh: {} }, firstHitOnly: true };
    let best = null;
    for (const { mesh, robot, link } of meshes()) {
      const hits = [];
      mesh.raycast(caster, hits);
      for (const hit of hits)
        if (!best || hit.distance < best.distance) best = { distance: hit.distance, point: hit.point, mesh, robot, link };
    }
    return best;
  }
  /** Return the corners of the boxes around the given meshes, in the scene. */
  function corners(found) {
    const points = [];
    for (const { mesh } of found) {
      mesh.geometry.boundingBox ?? mesh.geometry.computeBoundingBox();
      const { min, max } = mesh.geometry.boundingBox;
      for (let k = 0; k < 8; k++) {
        const corner = vector(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
        points.push(corner.applyMatrix4(mesh.matrixWorld));
      }
    }
    return points;
  }

  // -- fit ------------------------------------------------------------------------------------------------
  const FREE = 0.84; // part of the picture that is filled: cube and bar are at its edges
  /** Return the middle of points, and the distance from which the camera, as it is turned, sees all of them. */
  function standoff(points) {
    const [low, high] = [vector(Infinity, Infinity, Infinity), vector(-Infinity, -Infinity, -Infinity)];
    for (const point of points) {
      low.min(point);
      high.max(point);
    }
    const center = low.add(high).multiplyScalar(0.5);
    const back = viser.camera.quaternion.clone().invert();
    const up = FREE * Math.tan((viser.camera.fov * Math.PI) / 360);
    const across = up * viser.camera.aspect;
    let distance = 0;
    for (const point of points) {
      const { x, y, z } = point.clone().sub(center).applyQuaternion(back); // x right, y up, z to the camera
      distance = Math.max(distance, z + Math.abs(x) / across, z + Math.abs(y) / up);
    }
    return { center, distance };
  }
  function fit(found = meshes()) {
    const points = corners(found);
    if (!points.length) return;
    const { center, distance } = standoff(points);
    const control = viser.cameraControl;
    void control.moveTo(center.x, center.y, center.z, true);
    void control.dollyTo(distance, true);
    draw();
  }
  function fitAt(event) {
    if (!ready() || measuring) return;
    const hit = pick(event.clientX, event.clientY);
    fit(hit ? meshes().filter(({ robot, link }) => robot === hit.robot && link === hit.link) : meshes());
  }

  // -- names ----------------------------------------------------------------------------------------------
  const label = make('div', 'twin-name');
  label.hidden = true;
  let lit = [];
  let pointer = null;
  function highlight(hit) {
    const key = hit ? `${hit.robot}/${hit.link}` : '';
    if (key === (lit.key ?? '')) return;
    for (const [material, color] of lit) material.emissive.copy(color);
    lit = [];
    lit.key = key;
    if (hit)
      for (const { mesh, robot, link } of meshes()) {
        if (robot !== hit.robot || link !== hit.link || !mesh.material?.emissive) continue;
        lit.push([mesh.material, mesh.material.emissive.clone()]);
        mesh.material.emissive.setRGB(0.1, 0.22, 0.42);
      }
    draw();
  }
  function look() {
    const at = pointer;
    pointer = null;
    if (!at || !ready()) return;
    const hit = at.target === viser.canvas && !at.buttons ? pick(at.x, at.y) : null;
    highlight(hit);
    label.hidden = !hit;
    if (!hit) return;
    const robots = new Set(meshes().map(({ robot }) => robot));
    label.textContent = robots.size > 1 ? `${hit.link} of ${hit.robot}` : hit.link;
    label.style.left = `${Math.min(at.x + 14, innerWidth - label.offsetWidth - 4)}px`;
    label.style.top = `${Math.max(at.y - 32, 2)}px`;
  }
  window.addEventListener('pointermove', (e) => {
    if (e.pointerType === 'touch') return;
    pointer = { x: e.clientX, y: e.clientY, buttons: e.buttons, target: e.target };
  });
  setInterval(look, 80); // a ray through all triangles for each report of the mouse would be too much

  // -- measure --------------------------------------------------------------------------------------------
  const SVG = 'http://www.w3.org/2000/svg';
  const sheet = document.createElementNS(SVG, 'svg');
  sheet.setAttribute('class', 'twin-measure');
  sheet.setAttribute('role', 'img');
  sheet.setAttribute('aria-label', 'Measured distance');
  document.body.append(sheet);
  let measuring = false;
  let ends = [];
  function part(name, attributes) {
    const node = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    sheet.append(node);
    return node;
  }
  function project(point) {
    const box = viser.canvas.getBoundingClientRect();
    const at = point.clone().project(viser.camera);
    return { x: box.left + (box.width * (1 + at.x)) / 2, y: box.top + (box.height * (1 - at.y)) / 2, front: at.z < 1 };
  }
  /** Return the difference of two points of the scene in the axes of the world, in mm at the robot's own size. */
  function between(a, b, robot) {
    const world = viser.nodeRefFromName['/WorldAxes'].matrixWorld.clone().invert();
    const d = b.clone().applyMatrix4(world).sub(a.clone().applyMatrix4(world));
    const base = viser.nodeRefFromName[`/${robot}`]?.matrixWorld.elements;
    const axes = viser.nodeRefFromName['/WorldAxes'].matrixWorld.elements;
    const size = (m) => Math.hypot(m[0], m[1], m[2]);
    const scale = base ? size(base) / size(axes) : 1;
    return d.multiplyScalar(1000 / scale);
  }
  function drawMeasure() {
    sheet.replaceChildren();
    if (!ends.length) return;
    const points = ends.map(({ mesh, local }) => local.clone().applyMatrix4(mesh.matrixWorld));
    const seen = points.map(project);
    if (seen.length === 2) {
      part('line', { x1: seen[0].x, y1: seen[0].y, x2: seen[1].x, y2: seen[1].y, stroke: '#fff', 'stroke-width': 5 });
      part('line', { x1: seen[0].x, y1: seen[0].y, x2: seen[1].x, y2: seen[1].y, stroke: '#c4302b', 'stroke-width': 2.5 });
      const d = between(points[0], points[1], ends[0].robot);
      const text = part('text', { x: (seen[0].x + seen[1].x) / 2 + 10, y: (seen[0].y + seen[1].y) / 2 - 8 });
      text.textContent = `${d.length().toFixed(2)} mm   (x ${d.x.toFixed(2)}, y ${d.y.toFixed(2)}, z ${d.z.toFixed(2)})`;
      const over = text.getBoundingClientRect().right - innerWidth + 8;
      if (over > 0) text.setAttribute('x', Number(text.getAttribute('x')) - over);
      sheet.dataset.mm = String(d.length());
    }
    for (const { x, y } of seen) part('circle', { cx: x, cy: y, r: 5, fill: '#c4302b', stroke: '#fff', 'stroke-width': 2 });
  }
  function measure(on) {
    measuring = on;
    ends = [];
    buttons.measure.setAttribute('aria-pressed', String(on));
    if (on) say(`Click two points of the ${thing}.`);
    drawMeasure();
  }
  let down = null;
  window.addEventListener('pointerdown', (e) => (down = { x: e.clientX, y: e.clientY, target: e.target }), true);
  window.addEventListener('pointerup', (e) => {
    if (!measuring || !down || down.target !== viser.canvas || e.target !== viser.canvas) return;
    if (Math.hypot(e.clientX - down.x, e.clientY - down.y) > 4) return; // the view was turned
    const hit = pick(e.clientX, e.clientY);
    if (!hit) return say('There is nothing at this point.');
    if (ends.length === 2) ends = [];
    ends.push({ mesh: hit.mesh, robot: hit.robot, local: hit.mesh.worldToLocal(hit.point.clone()) });
    drawMeasure();
  }, true);

  // -- copies and links -----------------------------------------------------------------------------------
  const said = make('div', 'twin-said');
  said.setAttribute('role', 'status');
  said.hidden = true;
  let sayTimer = 0;
  function say(text) {
    said.textContent = text;
    said.hidden = false;
    clearTimeout(sayTimer);
    sayTimer = setTimeout(() => (said.hidden = true), 5000);
  }
  async function write(text, what) {
    try {
      await navigator.clipboard.writeText(text);
      say(`${what} copied.`);
    } catch {
      window.prompt(`${what}: copy this text`, text); // a browser may refuse the clipboard, as over http
    }
  }
  // text of the page, with the button below it that copies it
  document.addEventListener('click', (e) => {
    const button = e.target instanceof Element && e.target.closest('[data-copies]');
    const text = button && button.parentElement.querySelector('[data-copied]');
    if (text) void write(text.textContent, button.dataset.copies);
  });
  async function state() {
    const answer = await fetch('state.json', { cache: 'no-store' });
    if (!answer.ok) throw new Error(`HTTP ${answer.status}`);
    return answer.json();
  }
  async function copy(kind) {
    try {
      const { link, ...rest } = await state();
      if (kind === 'link') {
        await write(`${location.origin}${location.pathname}#${link}`, 'Link to this posture and time');
      } else await write(JSON.stringify(rest, null, 2), 'Pose of the tool and joint values');
    } catch (error) {
      say(`Not copied: ${error.message}.`);
    }
  }
  /** Enter the posture of a link into the field of the panel; try again until the panel is drawn. */
  function follow(link, tries = 200) {
    const input = document.querySelector('input[aria-label="posture link"]');
    if (!input) {
      if (tries > 0) setTimeout(follow, 300, link, tries - 1);
      return;
    }
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(input, link);
    input.dispatchEvent(new Event('input', { bubbles: true }));
  }
  window.addEventListener('hashchange', () => {
    const link = decodeURIComponent(location.hash.slice(1));
    if (!link.startsWith('q=')) return;
    history.replaceState(null, '', location.pathname + location.search);
    follow(link);
  });
  if (window.twinLink) follow(window.twinLink);

  // -- dark -----------------------------------------------------------------------------------------------
  const system = window.matchMedia('(prefers-color-scheme: dark)');
  const KEY = 'twin-scheme';
  const wanted = () => localStorage.getItem(KEY) ?? (system.matches ? 'dark' : null);
  /** Mark what is behind the transparent picture: viser gives it the colour of its own theme. */
  function room() {
    for (let at = viser.canvas; at; at = at.parentElement) {
      if (at.classList.contains('twin-room')) return;
      if (getComputedStyle(at).backgroundColor === 'rgba(0, 0, 0, 0)') continue;
      at.classList.add('twin-room');
      return;
    }
  }
  /** Draw the lines of the floor dark on a dark page. */
  function floor() {
    const dark = document.documentElement.getAttribute('data-mantine-color-scheme') === 'dark';
    viser.nodeRefFromName['/floor']?.traverse((part) => {
      const lines = part.material?.uniforms;
      if (!lines?.cellColor?.value?.setHex) return;
      part.userData.lines ??= [lines.cellColor.value.clone(), lines.sectionColor.value.clone()];
      if (part.userData.dark === dark) return;
      part.userData.dark = dark;
      if (dark) {
        lines.cellColor.value.setHex(0x2a3139);
        lines.sectionColor.value.setHex(0x3d4752);
      } else [lines.cellColor, lines.sectionColor].forEach((line, k) => line.value.copy(part.userData.lines[k]));
      draw();
    });
  }
  setInterval(floor, 1000); // the floor comes with the robot
  function dress() {
    const scheme = wanted();
    const root = document.documentElement;
    room();
    if (scheme && root.getAttribute('data-mantine-color-scheme') !== scheme) root.setAttribute('data-mantine-color-scheme', scheme);
    draw();
  }
  new MutationObserver(dress).observe(document.documentElement, { attributeFilter: ['data-mantine-color-scheme'] });
  system.addEventListener('change', dress);
  dress();
  function turn() {
    const now = document.documentElement.getAttribute('data-mantine-color-scheme');
    localStorage.setItem(KEY, now === 'dark' ? 'light' : 'dark');
    dress();
  }

  // -- the bar --------------------------------------------------------------------------------------------
  const help = document.querySelector('.twin-help');
  const bar = document.createElement('span');
  bar.className = 'twin-bar';
  help.insertBefore(bar, help.lastElementChild);
  const buttons = {};
  const POSTURE = [
    ['copy', 'Copy', 'Copy the pose of the tool and the joint values', () => copy('pose')],
    ['link', 'Link', 'Copy a link that opens this posture and time', () => copy('link')],
  ];
  const TOOLS = [
    ['fit', 'Fit', `Show the whole ${thing} (double click; on a body: that body)`, () => fit()],
    ['measure', 'Measure', `Measure between two points of the ${thing}`, () => measure(!measuring)],
    ...(thing === 'robot' ? POSTURE : []),
    ['dark', '◐', 'Dark or light page', turn],
  ];
  for (const [id, text, hint, act] of TOOLS) {
    const button = document.createElement('button');
    button.textContent = text;
    button.title = hint;
    button.dataset.id = id;
    if (text === '◐') button.setAttribute('aria-label', hint);
    button.onclick = act;
    bar.append(button);
    buttons[id] = button;
  }
  window.addEventListener('dblclick', (e) => e.target === viser.canvas && fitAt(e));
  window.addEventListener('keydown', (e) => e.key === 'Escape' && measuring && measure(false));

  // -- the view cube ----------------------------------------------------------------------------------------
  const cube = make('nav', 'twin-cube');
  cube.setAttribute('aria-label', 'Views');
  // name, direction from the robot to the camera, and what is up on the face; axes of the world, z up
  const FACES = [
    ['front', [1, 0, 0], [0, 0, 1]],
    ['back', [-1, 0, 0], [0, 0, 1]],
    ['right', [0, 1, 0], [0, 0, 1]],
    ['left', [0, -1, 0], [0, 0, 1]],
    ['top', [0, 0, 1], [-1, 0, 0]],
    ['below', [0, 0, -1], [1, 0, 0]],
  ];
  // fingers need larger faces: those that are seen too obliquely are hidden
  const coarse = window.matchMedia('(pointer: coarse)').matches;
  const HALF = coarse ? 38 : 26;
  const FLAT = coarse ? 0.54 : 0.05;
  const BESIDE = coarse ? 140 : 104; // px from the right edge of the picture to the cube
  const faces = FACES.map(([name, n, up]) => {
    const button = make('button', '', cube);
    button.textContent = name;
    button.title = `View from: ${name}`;
    button.dataset.id = `view-${name}`;
    button.onclick = () => turnTo(n);
    return { button, n, up };
  });
  function turnTo(n) {
    if (!ready()) return;
    const d = vector(...n).transformDirection(viser.nodeRefFromName['/WorldAxes'].matrixWorld);
    const polar = Math.acos(Math.max(-1, Math.min(1, d.y)));
    // from above or below, the azimuth is free: it stays
    const azimuth = Math.hypot(d.x, d.z) < 1e-6 ? viser.cameraControl.azimuthAngle : Math.atan2(d.x, d.z);
    void viser.cameraControl.rotateTo(azimuth, polar, true);
    draw();
  }
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  let placed = '';
  function place() {
    if (!ready()) return;
    const box = viser.canvas.getBoundingClientRect();
    const axes = viser.nodeRefFromName['/WorldAxes'];
    if (!axes) return;
    const view = viser.camera.matrixWorldInverse.clone().multiply(axes.matrixWorld);
    const now = [box.left, box.top, box.width, ...view.elements].map((v) => v.toFixed(3)).join();
    if (now === placed) return;
    placed = now;
    room();
    help.classList.toggle('narrow', box.width < 640);
    cube.hidden = box.width < 260;
    // the panel of a drawing is at the right
    cube.style.left = `${thing === 'drawing' ? box.left + 12 : box.right - BESIDE}px`;
    cube.style.top = `${Math.max(box.top, 0) + 10}px`;
    help.style.left = `${box.left + box.width / 2}px`;
    for (const { button, n, up } of faces) {
      const [z, y] = [vector(...n).transformDirection(view), vector(...up).transformDirection(view)];
      const x = vector(...cross(up, n)).transformDirection(view);
      button.hidden = z.z < FLAT;
      // the page's y points down: rows and columns of y change sign
      const m = [x.x, -x.y, x.z, 0, -y.x, y.y, -y.z, 0, z.x, -z.y, z.z, 0, HALF * z.x, -HALF * z.y, HALF * z.z, 1];
      button.style.transform = `matrix3d(${m.map((v) => v.toFixed(5)).join()})`;
    }
    drawMeasure();
  }
  (function tick() {
    requestAnimationFrame(tick);
    place();
    if (ends.length) drawMeasure();
  })();

  // -- slow graphics ----------------------------------------------------------------------------------------
  const SHARES = [1, 0.7, 0.5, 0.35];
  const [SLOW, FAST] = [45, 22]; // ms of a display cycle in which a picture was drawn
  const STILL = 1200; // ms without motion after which pictures have all pixels
  let level = 0;
  let frame = -1; // number of the last picture
  let cycle = 0; // time of the last display cycle
  let moved = 0; // time of the last motion of camera or links
  let seen = ''; // where camera and links were
  let [slow, fast] = [0, 0];
  /** Return where camera and links are, in few numbers; viser draws once a second though nothing has changed. */
  function stance() {
    let sum = 0;
    for (const [path, node] of Object.entries(viser.nodeRefFromName)) {
      const m = !path.includes('/mesh') && node?.matrixWorld?.elements;
      if (m) sum += m[0] + 2 * m[5] + 3 * m[10] + 5 * m[12] + 7 * m[13] + 11 * m[14];
    }
    return `${viser.camera.matrixWorld.elements.map((v) => v.toFixed(4)).join()} ${sum.toFixed(4)}`;
  }
  function pace(now) {
    const took = now - cycle;
    cycle = now;
    const store = viser.scene?.__r3f?.root?.getState?.();
    const count = store?.gl?.info?.render?.frame;
    if (count === undefined || !ready()) return;
    if (count !== frame) {
      frame = count;
      const at = stance();
      if (at !== seen) {
        seen = at;
        moved = now;
        // a picture that takes long delays the display cycle after it
        slow = took > SLOW ? slow + 1 : 0;
        fast = took < FAST ? fast + 1 : 0;
        if (slow > 2 && level < SHARES.length - 1) [level, slow] = [level + 1, 0];
        else if (fast > 240 && level > 0) [level, fast] = [level - 1, 0];
      }
    }
    if (level > 0 || store.viewport.dpr < FULL) share(store, now - moved > STILL ? 1 : SHARES[level]);
  }
  const FULL = Math.min(window.devicePixelRatio, 2);
  function share(store, part) {
    const dpr = FULL * part;
    if (Math.abs(store.viewport.dpr - dpr) > 1e-3) {
      store.setDpr(dpr);
      draw();
    }
  }
  const fixed = new URLSearchParams(location.search).has('fixedDpr'); // the address says how many pixels
  if (!fixed)
    (function beat(now) {
      requestAnimationFrame(beat);
      if (now && !document.hidden) pace(now);
    })();

  window.twinTools = { pick, meshes, fit, level: () => level, dpr: () => viser.scene?.__r3f?.root?.getState?.().viewport.dpr };
})();
