// Added to the page of viser: names for controls without one, keys, and a notice when the server has gone.
(() => {
  const root = document.getElementById('root');
  root?.setAttribute('role', 'main');
  const style = document.createElement('style');
  style.textContent = `
    :root, :root[data-mantine-color-scheme] { --mantine-color-dimmed: light-dark(#56606b, #aab4be) !important; --mantine-color-blue-filled: #1b6ec2 !important; --mantine-primary-color-filled: #1b6ec2 !important; --mantine-color-blue-filled-hover: #185fa8 !important; --mantine-primary-color-filled-hover: #185fa8 !important; --mantine-color-gray-filled: #5c6670 !important; }
    label { color: light-dark(#56606b, #aab4be); }
    .twin-unseen { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
    .twin-keys, .twin-gone { font: 15px/1.4 system-ui, sans-serif; color: #17212e; background: #fff; border: 1px solid #b9c4d0; border-radius: 12px; padding: 16px 20px; }
    .twin-keys th { text-align: left; padding: 4px 16px 4px 0; } .twin-keys button, .twin-gone button { font: inherit; margin-top: 10px; padding: 8px 14px; min-height: 40px; }
    .twin-gone { position: fixed; z-index: 10000; top: 12px; left: 50%; transform: translateX(-50%); width: min(30rem, 92vw); border: 2px solid #b3101e; }
    .twin-gone[hidden] { display: none; }
    .twin-help { position: fixed; z-index: 900; left: 50%; bottom: 14px; transform: translateX(-50%); font: 15px/1.4 system-ui, sans-serif; color: #17212e; background: #ffffffe8; border: 1px solid #b9c4d0; border-radius: 20px; padding: 2px 4px 2px 14px; white-space: nowrap; }
    .twin-help button { font: inherit; font-weight: 650; min-width: 40px; min-height: 40px; border: 0; background: none; cursor: pointer; color: #17212e; }
    @media (pointer: coarse) {
      button:not(.twin-cube button), input:not([type="checkbox"]), select, [role="button"], summary { min-height: 40px !important; }
      button:not(.twin-cube button) { min-width: 40px !important; }
      .mantine-Slider-root, .mantine-Slider-trackContainer { min-height: 40px !important; }
      .mantine-Slider-thumb { width: 40px !important; height: 40px !important; border: 0 !important; background: radial-gradient(circle, #1b6ec2 0 9px, transparent 10px) !important; }
      .mantine-Checkbox-inner, .mantine-Checkbox-inner input { width: 40px !important; height: 40px !important; min-height: 40px; }
      .mantine-Checkbox-inner { display: grid; place-items: center; }
      .mantine-Checkbox-inner input { border-width: 9px !important; background-clip: padding-box; border-color: transparent !important; box-shadow: inset 0 0 0 1.5px #7c8896; }
      .mantine-NumberInput-controls { display: none !important; } /* two buttons in 40 px are too small for a finger */
    }
    .twin-headline { display: none; }
    @media (max-width: 640px) {
      .twin-sheet, .twin-sheet .mantine-ScrollArea-content > div { width: 100vw !important; }
      .twin-headline { display: block; padding: 8px 1em 0; font-size: 13px; line-height: 1.5; }
    }
    @media print { .twin-help { display: none; } }`;
  document.head.append(style);
  const head = document.createElement('header');
  head.className = 'twin-unseen';
  const title = document.createElement('h1');
  head.append(title);
  root?.before(head);

  // -- names ------------------------------------------------------------------------------------------
  const worded = (e) => (e.getAttribute('aria-label') || e.textContent || e.title || '').trim();
  function around(e) {
    for (let at = e.parentElement, k = 0; at && k < 6; at = at.parentElement, k++) {
      const text = at.textContent.trim();
      if (text) return text.split('\n')[0].slice(0, 60);
    }
    return 'value';
  }
  function name() {
    title.textContent = document.title || 'twin';
    for (const button of document.querySelectorAll('button'))
      if (!worded(button)) button.setAttribute('aria-label', /close/i.test(button.className) ? 'Close' : 'Connection and settings');
    for (const image of document.querySelectorAll('img:not([alt])')) image.alt = '';
    for (const bar of document.querySelectorAll('[role="progressbar"]'))
      if (!bar.getAttribute('aria-label')) bar.setAttribute('aria-label', 'Progress');
    for (const slider of document.querySelectorAll('[role="slider"]'))
      if (!slider.getAttribute('aria-label') && !slider.getAttribute('aria-labelledby')) slider.setAttribute('aria-label', around(slider));
    for (const input of document.querySelectorAll('input:not([type="hidden"])'))
      if (!input.labels?.length && !input.getAttribute('aria-label')) input.setAttribute('aria-label', around(input));
  }
  setInterval(name, 700);

  // Software rendering is said once, and does not stay over the robot.
  setTimeout(() => {
    for (const notice of document.querySelectorAll('[class*="Notification-root"]'))
      if (notice.textContent.includes('Software WebGL')) notice.querySelector('button')?.click();
  }, 8000);

  // -- keys -------------------------------------------------------------------------------------------
  const faces = window.twinContent === 'faces'; // the page of a STEP file: nothing moves
  const moves = [
    ['Move the tool', 'drag the arrows at the tool; the rings rotate it'],
    ['Move any link', 'Shift and drag it'],
    ['Play or pause', 'Space'],
    ['Undo the last drag', 'Ctrl-Z'],
  ];
  const rows = [
    ...(faces ? [['Pick a face', 'click it; click it again to make it the current one']] : moves),
    ['Rotate the view', 'drag the background; right button: shift the view'],
    ['Zoom', 'wheel'],
    ['Show these keys', '?'],
  ];
  const keys = document.createElement('dialog');
  keys.className = 'twin-keys';
  keys.setAttribute('aria-label', 'Mouse and keys');
  const table = document.createElement('table');
  for (const [what, how] of rows) {
    const row = table.insertRow();
    const cell = document.createElement('th');
    cell.scope = 'row';
    cell.textContent = what;
    row.append(cell);
    row.insertCell().textContent = how;
  }
  const close = document.createElement('button');
  close.textContent = 'Close';
  close.onclick = () => keys.close();
  keys.append(table, close);
  const help = document.createElement('aside');
  help.className = 'twin-help';
  help.setAttribute('aria-label', 'Help');
  help.textContent = faces ? 'Click a face: its TOML is in the panel. ' : 'Drag the arrows: the tool follows. ';
  const more = document.createElement('button');
  more.textContent = '?';
  more.setAttribute('aria-label', 'Mouse and keys');
  more.onclick = () => keys.showModal();
  help.append(more);
  document.body.append(keys, help);
  const press = (pattern) => {
    for (const button of document.querySelectorAll('button'))
      if (pattern.test(button.textContent.trim()) && !button.disabled) {
        button.click();
        return;
      }
  };
  window.addEventListener('keydown', (e) => {
    const typing = e.target instanceof HTMLElement && (e.target.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(e.target.tagName));
    if (typing || e.altKey) return;
    const command = e.ctrlKey || e.metaKey;
    const undo = command && !e.shiftKey && e.key.toLowerCase() === 'z';
    if (command && !undo) return;
    // the list of the keys covers the robot: only its own key acts then
    if (keys.open && e.key !== '?') return;
    const play = e.code === 'Space' && !(e.target instanceof HTMLButtonElement);
    if (!undo && !play && e.key !== '?') return;
    e.preventDefault();
    if (undo) press(/^↶ Undo/);
    // a key that is held down repeats, which would switch there and back
    else if (e.repeat) return;
    else if (play) press(/^(▶ Play|❚❚ Pause)$/);
    else if (keys.open) keys.close();
    else keys.showModal();
  });

  // -- a phone ----------------------------------------------------------------------------------------
  // viser's panel covers the lower half of a narrow page, at its right: it gets the whole width, starts folded, and its
  // heading opens it
  (function fold(tries = 100) {
    if (innerWidth > 640) return;
    const panel = [...document.querySelectorAll('.mantine-Paper-root')].find((o) => getComputedStyle(o).position === 'fixed');
    panel?.classList.add('twin-sheet');
    const heading = panel?.querySelector('[style*="cursor: pointer"]');
    if (!heading || panel.offsetHeight < 0.25 * innerHeight) {
      if (tries > 0) setTimeout(fold, 200, tries - 1); // viser's own script begins later
      return;
    }
    // the bar with the tools of the view is above the panel, whatever its height
    new ResizeObserver(() => (help.style.bottom = `${panel.offsetHeight + 8}px`)).observe(panel);
    heading.click();
    // the first view is made for a wide page; the meshes come one after the other, so the view follows until all are here
    let touched = false;
    addEventListener('pointerdown', (e) => (touched ||= e.target instanceof HTMLCanvasElement), true);
    (function fill(count, calm, tries) {
      const tools = window.twinTools;
      const now = tools?.meshes().length ?? 0;
      if (now && !touched) tools.fit();
      const still = now > 0 && now === count ? calm + 1 : 0;
      if (still < 10 && tries > 0 && !touched) setTimeout(fill, 300, now, still, tries - 1);
    })(0, 0, 300);
  })();

  // -- the server has gone ------------------------------------------------------------------------------
  const gone = document.createElement('div');
  gone.className = 'twin-gone';
  gone.setAttribute('role', 'alert');
  gone.hidden = true;
  const text = document.createElement('p');
  text.style.margin = '0';
  const again = document.createElement('button');
  again.textContent = 'Reload the page';
  again.onclick = () => location.reload();
  gone.append(text, again);
  document.body.append(gone);
  // the server writes the command line into the page
  const command = window.twinCommand || 'the command that opened this page';
  let missed = 0;
  async function look() {
    if (document.hidden || !location.protocol.startsWith('http')) return;
    try {
      await fetch(location.pathname, { method: 'HEAD', cache: 'no-store' });
      missed = 0;
    } catch {
      missed++;
    }
    text.textContent = `The server does not answer. If it has ended, run ${command} again, then reload this page.`;
    gone.hidden = missed < 2;
  }
  setInterval(look, 2500);
})();
