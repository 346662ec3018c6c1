/** Machines beside their models: which is solid, how far their tips and joints are apart, and the trainer's buttons. */

import type { App } from './app';
import type { MachinesInfo, MachinesState, MachineState, Message } from './protocol';

/** Seconds of the curve, its size in pixels, and the smallest range in m. */
const SECONDS = 12;
const [WIDE, HIGH] = [184, 84];
const SMALLEST = 0.001;
/** Height of a panel that is as wide as the page, as a fraction of the space above the small picture. */
const ACROSS = 0.4;
const DEG = Math.PI / 180;

const PHASES: Record<MachineState['phase'], string> = {
  teleoperate: 'The hand moves machine and model.',
  rehearse: 'The hand moves the model; the machine is at rest.',
  judged: 'The recorded motion has passed its check: run it on the machine.',
  replay: 'The machine and the model repeat the recorded motion.',
  done: 'The machine has repeated the recorded motion.',
  stopped: 'Stopped.',
  follow: 'Solid: the machine’s measured joints. Ghost: its desired joints.',
};

/** Buttons of the trainer: mode, label, hint. */
const MODES = [
  ['teleoperate', 'Engage', 'The hand moves the machine and its model'],
  ['rehearse', 'Rehearse', 'Disengage the machine: the hand moves only the model, and the motion is recorded'],
  ['judge', 'Judge', 'End the rehearsal, and check speed and reach of the recorded motion'],
  ['replay', 'Run', 'Engage the machine: it repeats the recorded motion; speed and deviation are checked'],
] as const;

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, id = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (id) node.dataset['id'] = id;
  if (text) node.textContent = text;
  return node;
};

export class Machines {
  private readonly board = make('section', 'machines');
  private readonly title = make('h2', '', 'Machine and model');
  private readonly level = make('p', 'machine-level');
  private readonly view = make('p', 'machine-view');
  private readonly said = make('p', 'machine-said');
  private readonly curve = make('canvas', 'deviation-curve');
  private readonly apart = make('p', 'deviation-text');
  private readonly off = make('p', 'deviation-joints');
  private readonly buttons = new Map<string, HTMLButtonElement>();
  private readonly names: string[];
  private points: { t: number; tips: number[] }[] = [];
  private state: MachinesState | null = null;
  private dressed = '';
  private around = '';
  private drawn = -1;

  constructor(
    parent: HTMLElement,
    private readonly app: App,
    private readonly info: MachinesInfo,
  ) {
    this.names = Object.keys(info.models);
    this.board.className = 'score machines';
    this.board.setAttribute('aria-label', 'Machine and model');
    this.curve.width = 2 * WIDE;
    this.curve.height = 2 * HIGH;
    this.curve.setAttribute('role', 'img');
    this.curve.setAttribute('aria-label', 'Distance of the tips of machine and model over time');
    if (info.trains) this.view.title = 'Tap the camera pedal to swap machine and model: one is drawn solid, the other as a ghost';
    this.board.append(this.title, this.level, this.view, this.curve, this.apart, this.off, this.said);
    if (info.trains) this.board.append(this.row());
    parent.append(this.board);
  }

  private row(): HTMLElement {
    const row = make('div');
    row.className = 'row';
    for (const [mode, label, hint] of MODES) row.append(this.button(mode, label, hint, () => this.ask(mode)));
    row.append(
      this.button('machine-start', 'Start', 'Press the start button of the machine: it moves to home', () => this.app.ask('button', { button: 'start' })),
      this.button('machine-stop', 'Stop', 'Press the stop button of the machine', () => this.app.ask('button', { button: 'stop' })),
    );
    return row;
  }

  private ask(mode: string): void {
    if (mode === 'replay') this.app.console?.pens.use();
    this.app.ask('training', { mode });
  }

  private button(id: string, label: string, hint: string, press: () => void): HTMLButtonElement {
    const button = make('button', id, label);
    button.title = hint;
    button.onclick = press;
    this.buttons.set(id, button);
    return button;
  }

  hear(message: Message): void {
    if (message.type === 'state' && message.machines) {
      this.state = message.machines;
      // the page keeps the hands during a replay: silent hands would stop it
      if (Object.values(message.machines.robots).some((r) => r.phase === 'replay')) this.app.console?.pens.use();
    }
    if (message.type !== 'deviations') return;
    this.points.push({ t: message.time, tips: this.names.map((n) => message.robots[n]?.tip ?? 0) });
    while (this.points.length && (this.points[0] as { t: number }).t < message.time - SECONDS) this.points.shift();
    const { limit } = this.info;
    const tips = this.names.map((n) => `${(1000 * (message.robots[n]?.tip ?? 0)).toFixed(2)} mm`).join(', ');
    this.apart.textContent = `Deviation of the tips: ${tips} (last ${SECONDS} s${limit ? `; red: force cue above ${(1000 * limit).toFixed(0)} mm` : ''})`;
    const off = this.names.map((n) => `${n}: ${this.largest(n, message.robots[n]?.joints ?? [])}`);
    this.off.textContent = ['Largest joint differences:', ...off].join('\n');
  }

  /** Return the joint with the largest difference, as text. */
  private largest(name: string, off: readonly number[]): string {
    const joints = this.info.joints[name] ?? [];
    let [best, size, text] = ['', -1, ''];
    joints.forEach(([joint, angle], i) => {
      const value = off[i] ?? 0;
      const shown = angle ? Math.abs(value) / DEG : Math.abs(value) * 1000;
      if (shown > size) [best, size, text] = [joint, shown, `${shown.toFixed(2)}${angle ? '°' : ' mm'}`];
    });
    return `${best} ${text}`;
  }

  /** Show state and curve; called with the other controls. */
  refresh(): void {
    const { state } = this;
    if (!state) return this.place();
    this.board.dataset['view'] = state.view;
    this.dress(state.view);
    const robots = this.names.map((n) => [n, state.robots[n]] as const);
    this.level.textContent = robots.map(([n, r]) => `${n}: ${r?.level ?? 'does not answer'}`).join('\n');
    if (this.info.trains)
      this.view.textContent = `View: ${state.view === 'real' ? 'machine solid, model ghost' : 'model solid, machine ghost'} (tap the camera pedal)`;
    const one = robots[0]?.[1];
    const bad = robots.map(([, r]) => r?.problem ?? r?.why ?? '').find((t) => t) ?? '';
    this.said.textContent = bad || (one ? PHASES[one.phase] : '');
    this.said.dataset['tone'] = bad ? 'bad' : '';
    for (const [mode] of MODES) {
      const button = this.buttons.get(mode);
      if (button) button.setAttribute('aria-pressed', String(state.mode === mode));
    }
    this.place();
    this.draw();
  }

  /** Draw machines solid and models as ghosts, or the reverse, as the view requires. */
  private dress(view: MachinesState['view']): void {
    const loaded = this.app.members.filter((m) => m.robot).length;
    const now = `${view} ${loaded}`;
    if (now === this.dressed) return;
    this.dressed = now;
    for (const [machine, model] of Object.entries(this.info.models))
      for (const { model: about, robot } of this.app.members)
        if (about.info?.name === machine || about.info?.name === model)
          robot?.veil((about.info.name === model) === (view === 'real'));
    this.app.world.dirty = true;
  }

  /** Width in pixels that the panel covers at the left; 0 on a phone, where it spans the width. */
  covers(): number {
    const { right } = this.board.getBoundingClientRect();
    return right < window.innerWidth / 2 ? right : 0;
  }

  private place(): void {
    const low = document.querySelector('header')?.getBoundingClientRect().bottom ?? 0;
    const top = Math.round(low) + 10;
    const above = (this.app.console?.views.corner.top ?? window.innerHeight) - top - 10;
    // A panel as wide as the page, as on a phone, leaves the lower part of the picture to the instruments.
    const high = this.covers() ? above : Math.round(ACROSS * above);
    const now = `${top} ${high} ${window.innerWidth} ${this.level.textContent} ${this.view.textContent} ${this.said.textContent}`;
    const over = () => this.board.scrollHeight - this.board.clientHeight;
    if (now === this.around && over() <= 0) return; // the text of the deviations may need more lines than before
    this.around = now;
    Object.assign(this.board.style, { top: `${top}px`, maxHeight: `${high}px` });
    // The buttons and the message are always visible; the rest only if there is space above the small picture.
    const spare = [this.off, this.apart, this.curve, this.title, this.view];
    for (const part of spare) part.hidden = false;
    this.said.style.maxHeight = '';
    for (const part of spare) part.hidden = over() > 0;
    // A long message is scrolled, so that it does not push the buttons out.
    if (over() > 0) this.said.style.maxHeight = `${Math.max(0, this.said.clientHeight - over())}px`;
  }

  private draw(): void {
    const last = this.points.at(-1);
    if (!last || last.t === this.drawn) return;
    this.drawn = last.t;
    const pen = this.curve.getContext('2d') as CanvasRenderingContext2D;
    const { limit } = this.info;
    const top = 1.15 * Math.max(SMALLEST, limit ?? 0, ...this.points.flatMap((p) => p.tips));
    const [x, y] = [(t: number) => (1 - (last.t - t) / SECONDS) * WIDE, (v: number) => HIGH - 1 - (v / top) * (HIGH - 2)];
    pen.setTransform(2, 0, 0, 2, 0, 0);
    pen.clearRect(0, 0, WIDE, HIGH);
    pen.lineWidth = 1;
    pen.strokeStyle = '#5a6b80';
    pen.strokeRect(0.5, 0.5, WIDE - 1, HIGH - 1);
    if (limit) {
      pen.setLineDash([4, 3]);
      pen.strokeStyle = '#d62f2f';
      pen.beginPath();
      pen.moveTo(0, y(limit));
      pen.lineTo(WIDE, y(limit));
      pen.stroke();
      pen.setLineDash([]);
    }
    pen.fillStyle = limit ? '#d62f2f' : '#5a6b80';
    pen.font = '10px sans-serif';
    pen.fillText(`${Number((1000 * (limit ?? top)).toPrecision(2))} mm`, 4, limit ? y(limit) + 11 : 11);
    pen.lineWidth = 1.6;
    this.names.forEach((_, i) => {
      pen.strokeStyle = ['#0a66c2', '#c7741b'][i % 2] as string;
      pen.beginPath();
      for (const p of this.points) pen.lineTo(x(p.t), y(p.tips[i] ?? 0));
      pen.stroke();
    });
  }
}
