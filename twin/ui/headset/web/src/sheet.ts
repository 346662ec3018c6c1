/** The controls of this page: simulation, interaction, scene, robot. */

import type { App } from './app';
import type { Button, Control, Sheet, Slider, Tab, Tone } from './controls';
import type { Mode } from './grab';
import { difference, isAngle, jointValue, length } from './model';
import type { State } from './protocol';
import { atConsole, pedals } from './sheet_console';
import { taskControls } from './score';
import { robot, scene } from './sheet_scene';

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

export function makeSheet(app: App): Sheet {
  const led = app.console ? [atConsole(app, app.console)] : [simulation(app), interaction(app)];
  const tabs = [...led, scene(app), robot(app)];
  if (app.model.several) for (const tab of tabs) if (tab.id !== 'console') tab.controls.unshift(which(app, tab.id));
  return {
    tabs,
    folds: Boolean(app.console?.info.task && app.console.info.tools.length),
    transport: app.console ? [pedals(app.console), app.console.plan.controls(), ...(app.console.info.task ? taskControls(app) : [])] : transport(app),
    status: { kind: 'text', id: 'status', text: () => app.model.status().text, tone: () => app.model.status().tone },
    lost: () => app.model.line === 'reconnecting' || app.model.line === 'refused',
  };
}

/** Return the choice of the active robot for a tab. */
function which(app: App, tab: string): Control {
  return {
    kind: 'choice',
    id: `robot-${tab}`,
    label: 'Robot',
    hint: 'The robot to which these controls belong',
    options: () => app.model.robots.map((r, i) => [String(i), named(app, r.info?.name ?? '')]),
    get: () => String(app.model.chosen),
    set: (value) => app.choose(Number(value)),
  };
}

/** Return the name of a robot and, at a console, what people call it. */
function named(app: App, robot: string): string {
  const words = app.console?.info.called[robot];
  return words ? `${words.replace(/^the /, '').replace(/ \(.*\)$/, '')} · ${robot}` : robot;
}

const seconds = (t: number): string => `${t.toFixed(2)} s`;

function transport(app: App): Control[] {
  const s = () => app.model.state;
  const none = () => s().duration <= 0;
  return [
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'play',
          label: () => (s().playing ? '❚❚ Pause' : '▶ Play'),
          hint: 'Play the protocol, or pause (Space)',
          off: none,
          on: () => s().playing,
          press: () => app.ask('play', { on: !s().playing }),
        },
        { kind: 'button', id: 'begin', label: () => '|◀ Start', off: none, hint: 'Go to the start of the protocol', press: () => app.ask('seek', { t: 0 }) },
        {
          kind: 'button',
          id: 'loop',
          label: () => '↻ Loop',
          hint: 'Play the protocol again and again',
          off: none,
          on: () => s().loop,
          press: () => app.ask('loop', { on: !s().loop }),
        },
        {
          kind: 'button',
          id: 'slower',
          label: () => '– slower',
          hint: 'Play more slowly',
          off: none,
          press: () => app.ask('speed', { value: step(s().speed, -1) }),
        },
        {
          kind: 'button',
          id: 'speed',
          label: () => `${s().speed}×`,
          off: none,
          press: () => app.ask('speed', { value: 1 }),
          hint: 'Play in real time',
        },
        {
          kind: 'button',
          id: 'faster',
          label: () => '+ faster',
          hint: 'Play faster',
          off: none,
          press: () => app.ask('speed', { value: step(s().speed, 1) }),
        },
      ],
    },
    {
      kind: 'slider',
      id: 'time',
      label: 'Time',
      hint: 'Go to a time of the protocol',
      off: none,
      range: () => [0, Math.max(s().duration, 1e-3)],
      get: () => app.clipTime(),
      set: (t) => app.seek(t),
      show: (t) => `${t.toFixed(2)} / ${s().duration.toFixed(2)} s`,
      segments: () => s().phases,
    },
  ];
}

function step(speed: number, by: number): number {
  const i = SPEEDS.findIndex((v) => v >= speed - 1e-9);
  return SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, (i < 0 ? SPEEDS.length - 1 : i) + by))] ?? 1;
}

function simulation(app: App): Tab {
  const m = app.model;
  const controls: Control[] = [];
  const protocols = m.info?.protocols ?? [];
  if (protocols.length)
    controls.push({
      kind: 'choice',
      id: 'protocol',
      label: 'Protocol',
      hint: 'The motion that Play shows',
      options: () => protocols.map((p) => [p.name, p.name]),
      get: () => m.state.planning ?? m.state.protocol ?? '',
      set: (name) => app.ask('protocol', { name }),
    });
  controls.push(
    {
      kind: 'text',
      id: 'title',
      tone: () => 'faint',
      text: () => {
        if (!protocols.length) return 'This robot has no protocol to play.';
        const name = m.state.planning ?? m.state.protocol;
        const title = protocols.find((p) => p.name === name)?.title ?? '';
        return m.state.planning ? `${title} (planning …)` : title;
      },
    },
    { kind: 'text', id: 'phase', text: () => phaseText(app) },
    {
      kind: 'text',
      id: 'phases',
      tone: () => 'faint',
      text: () => m.state.phases.map(([n, a, b], i) => `${i + 1}  ${n}  ${a.toFixed(2)}–${seconds(b)}`).join('\n'),
    },
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'previous',
          label: () => '‹ previous phase',
          hint: 'Go to the start of the phase before',
          off: () => !m.state.phases.length,
          press: () => app.phase(-1),
        },
        {
          kind: 'button',
          id: 'next',
          label: () => 'next phase ›',
          hint: 'Go to the start of the next phase',
          off: () => !m.state.phases.length,
          press: () => app.phase(1),
        },
      ],
    },
    ...measures(app),
  );
  if (m.state.recording !== undefined)
    controls.push({
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'record',
          label: () => (m.state.recording ? '■ Stop recording' : '● Record'),
          hint: 'Record what you and other clients do, into the file of --record',
          on: () => m.state.recording === true,
          press: () => app.ask('record', { on: !m.state.recording }),
        },
      ],
    });
  return { id: 'simulation', label: 'Simulation', hint: 'Play the protocols of the robot, and see what is measured', controls };
}

function phaseText(app: App): string {
  const s = app.model.state;
  if (!s.phases.length) return '';
  const t = app.clipTime();
  const i = s.phases.findIndex(([, , end]) => t <= end + 1e-9);
  return s.phase
    ? `Phase ${(i < 0 ? s.phases.length - 1 : i) + 1} of ${s.phases.length}: ${s.phase}`
    : 'The robot is not on the protocol; press Play to return to it.';
}

/** Maximum accepted distance in m of the shaft from the RCM. */
const RCM = 1e-4;

/** Measured values; values beyond their limit are red. */
function measures(app: App): Control[] {
  const line = (id: string, text: (s: State) => string, tone: (s: State) => Tone = () => 'plain'): Control => ({
    kind: 'text',
    id: `measure-${id}`,
    text: () => text(app.model.state),
    tone: () => tone(app.model.state),
  });
  const over = (value: number | null, limit: number): Tone => (value !== null && Math.abs(value) > limit ? 'bad' : 'plain');
  const agree = () => app.model.info?.live_tolerance ?? 0;
  const apart = (s: State): number | null => s.residual_m ?? s.residual_rad;
  return [
    line('gap', (s) => (s.gap_m === null ? '' : `Loop gap  ${difference(s.gap_m)}`), (s) => over(s.gap_m, agree())),
    line(
      'residual',
      (s) => {
        if (s.scope !== null) return `Equations ↔ mechanism  ${s.scope}`;
        if (s.residual_rad !== null) return `Equations ↔ mechanism  ${difference(s.residual_rad, true)}`;
        return s.residual_m === null ? '' : `Equations ↔ mechanism  ${difference(s.residual_m)}`;
      },
      (s) => (s.scope === null ? over(apart(s), agree()) : 'warn'),
    ),
    line(
      'rcm',
      (s) => (s.rcm_error_m === null ? '' : `Distance of shaft from RCM  ${difference(s.rcm_error_m)}`),
      (s) => over(s.rcm_error_m, RCM),
    ),
    line('depth', (s) => (s.depth_m === null ? '' : `Insertion depth  ${length(s.depth_m)}`)),
  ];
}

/** Return the controls of the distances between joints: one is chosen, and a slider changes it. */
function dimensions(app: App): Control[] {
  const m = app.model;
  const distances = m.info?.distances ?? [];
  if (!distances.length) return [];
  let chosen = 0;
  const about = () => distances[chosen] ?? { name: '', drawn: 0, lower: 0, upper: 0 };
  const value = (index: number) => m.state.distances.find(([i]) => i === index)?.[1] ?? distances[index]?.drawn ?? 0;
  const off = () => m.heldByOther || m.line !== 'open';
  let waiting: number | null = null; // the value of the slider, until the mechanism has it
  return [
    { kind: 'head', text: 'Dimensions' },
    {
      kind: 'choice',
      id: 'distance',
      label: 'Distance of two joints on a link',
      hint: 'The length of a link that the slider changes',
      options: () => distances.map((d, i): [string, string] => [String(i), d.name]),
      get: () => String(chosen),
      set: (index) => {
        chosen = Number(index);
        waiting = null;
        app.refresh();
      },
    },
    {
      kind: 'slider',
      id: 'distance-value',
      label: 'length',
      hint: 'Change this length, and see which joints move; nothing is saved',
      range: () => [about().lower, about().upper],
      get: () => waiting ?? value(chosen),
      show: length,
      set: (v) => {
        waiting = v;
      },
      end: () => {
        if (waiting !== null) app.ask('distance', { index: chosen, value: waiting });
        waiting = null;
      },
      off,
    },
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'as-drawn',
          label: () => 'As drawn',
          off: () => off() || !m.state.distances.length,
          press: () => app.ask('distance', {}),
          hint: 'Set all distances back to those of the CAD',
        },
      ],
    },
    {
      kind: 'text',
      id: 'changed',
      tone: () => (m.state.distances.length ? 'warn' : 'faint'),
      text: () =>
        m.state.distances.length
          ? [
              ...m.state.distances.map(([i, v]) => `${distances[i]?.name ?? ''}: ${length(v)} (drawn: ${length(distances[i]?.drawn ?? 0)})`),
              'Protocols are still played as drawn.',
            ].join('\n')
          : 'All distances are as drawn. A change moves joints; meshes keep their shape, and nothing is saved.',
    },
  ];
}

function interaction(app: App): Tab {
  const m = app.model;
  const modes: [Mode, string, string][] = [
    ['auto', 'Tool', 'Grab the tool: it follows the hand. Grab another link: the grabbed point follows the hand.'],
    ['joint', 'Joint', 'Grab a link: the active joint that moves this link follows the hand.'],
    ['link', 'Link', 'Grab a link at any point: the mechanism moves so that the point follows the hand.'],
  ];
  const mode = (value: Mode, label: string): Button => ({
    kind: 'button',
    id: `mode-${value}`,
    label: () => label,
    hint: modes.find(([v]) => v === value)?.[2] ?? '',
    on: () => app.grab.mode === value,
    press: () => {
      app.grab.mode = value;
      app.refresh();
    },
  });
  const controls: Control[] = [
    { kind: 'head', text: 'What a grab moves' },
    { kind: 'row', items: modes.map(([value, label]) => mode(value, label)) },
    {
      kind: 'text',
      id: 'how',
      tone: () => 'faint',
      text: () => `${modes.find(([v]) => v === app.grab.mode)?.[2] ?? ''} ${app.how()}`,
    },
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'turning',
          label: () => 'Tool rotates with the hand',
          hint: 'Whether the tool also turns with the hand, or keeps its direction',
          on: () => app.grab.turning,
          press: () => {
            app.grab.turning = !app.grab.turning;
            app.refresh();
          },
        },
      ],
    },
  ];
  const postures = m.info?.postures ?? [];
  if (postures.length)
    controls.push(
      { kind: 'head', text: 'Postures' },
      {
        kind: 'row',
        items: postures
          .slice(0, 6)
          .map((name) => ({
            kind: 'button',
            id: `posture-${name}`,
            label: () => name,
            hint: `Move the robot to the posture ${name}`,
            press: () => app.ask('posture', { name }),
          })),
      },
    );
  controls.push({ kind: 'head', text: 'Joints' });
  for (const joint of m.info?.joints.filter((j) => j.active) ?? []) {
    const angle = isAngle(joint);
    const slider: Slider = {
      kind: 'slider',
      id: `joint-${joint.name}`,
      label: joint.name,
      hint: `Move joint ${joint.name}; the other active joints stay`,
      range: () => [joint.lower ?? (angle ? -Math.PI : -1), joint.upper ?? (angle ? Math.PI : 1)],
      get: () => m.joint(joint.name),
      show: (v) => jointValue(v, angle),
      begin: () => void app.grab.startJoint(app.member, joint),
      set: (v) => app.grab.moveJoint(v),
      end: () => app.grab.end(),
      off: () => m.heldByOther || m.line !== 'open',
    };
    controls.push(slider);
  }
  controls.push(...dimensions(app));
  return { id: 'interaction', label: 'Interaction', hint: 'Move the robot by hand, by joints and by lengths', controls };
}
