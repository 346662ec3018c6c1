/** The controls of a console: status of the hands, motion scale, views, and help for all input devices. */

import type { App } from './app';
import type { Console } from './console';
import type { Button, Control, Tab } from './controls';
import { TRACKED, TRACKED_PEDAL } from './console_hands';
import { type Pedal, SIDES } from './pens';
import { type ConsoleState, type MqttState, type Side, UDP } from './protocol';
import { taskButtons } from './task_list';
import type { Stereo } from './views';

const STEREO: readonly [Stereo, string][] = [
  ['one', 'One picture'],
  ['side', 'Stereo: side by side'],
  ['halves', 'Stereo: halves of the window'],
  ['red-cyan', 'Stereo: red and cyan'],
  ['rows', 'Stereo: rows (polarised monitor)'],
];

/** Return the controls that are always visible: pedals and jaws, for input devices without buttons for them. */
export function pedals(console: Console): Control {
  const pedal = (name: Pedal, label: string, hint: string): Button => ({
    kind: 'button',
    id: name,
    label: () => label,
    on: () => console.pens[name],
    off: () => console.plan.phase !== 'off',
    press: () => console.toggle(name),
    hint,
  });
  const jaw = (side: Side): Button => ({
    kind: 'button',
    id: `jaw-${side}`,
    label: () => console.jawLabel(side),
    on: () => console.pens[side].grip > 0,
    off: () => !console.info.jaws[side],
    press: () => console.toggleJaw(side),
    hint: console.info.jaws[side]
      ? 'Open or close the jaws, or switch the energy of a tool on and off'
      : 'The instrument of this hand has no jaw that moves',
  });
  const enable = 'While the pedal is pressed, the robot follows the hand; otherwise, only the hand moves';
  if (console.enables) return { kind: 'row', items: [pedal('clutch', 'Pedal', enable)] };
  return {
    kind: 'row',
    items: [
      pedal('clutch', 'Clutch', 'While the clutch pedal is pressed, the hands move freely and the instruments are at rest'),
      pedal('camera', 'Camera', 'While the camera pedal is pressed, the hands move the camera'),
      {
        kind: 'button',
        id: 'plan',
        label: () => 'Plan',
        on: () => console.plan.phase !== 'off',
        off: () => console.plan.phase !== 'off',
        press: () => console.plan.aim(),
        hint: 'Move a target, which may pass through anything, and plan a motion of the arm to it (hold P)',
      },
      jaw('left'),
      jaw('right'),
    ],
  };
}

async function wholeScreen(): Promise<void> {
  try {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await document.documentElement.requestFullscreen();
  } catch {
    // A browser may refuse; the picture then stays in its window.
  }
}

export function atConsole(app: App, console: Console): Tab {
  const list = (id: string, rows: readonly (readonly [string, string])[], shown = () => true): Control => ({
    kind: 'text',
    id,
    text: () => (shown() ? rows.map(([what, how]) => `${what}: ${how}`).join('\n') : ''),
  });
  const desk = () => !app.xr.presenting;
  const { views, enables } = console;
  const tracked = enables ? TRACKED_PEDAL : TRACKED;
  const stereo: Control[] = views.twoLenses
    ? [
        {
          kind: 'choice',
          id: 'stereo',
          label: 'Endoscope’s picture on this screen',
          hint: 'Show one picture, or one for each eye',
          options: () => [...STEREO],
          get: () => views.mode,
          set: (value) => views.setMode(value as Stereo),
        },
        {
          kind: 'row',
          items: [
            {
              kind: 'button',
              id: 'whole-screen',
              label: () => 'Full screen',
              on: () => document.fullscreenElement !== null,
              press: () => void wholeScreen(),
              hint: 'Full screen at 100 % zoom: the upper row of the picture is then the upper row of the monitor',
            },
            {
              kind: 'button',
              id: 'swap-rows',
              label: () => (views.swapped ? 'Odd rows: left eye' : 'Even rows: left eye'),
              on: () => views.swapped,
              off: () => views.mode !== 'rows',
              press: () => views.swapRows(),
              hint: 'Exchange the rows of both eyes, for monitors whose upper row is polarised for the right eye',
            },
          ],
        },
      ]
    : [];
  const controls: Control[] = [
    list('tracked', tracked, () => app.xr.presenting),
    { kind: 'head', text: 'Hands' },
    ...console.sides.toReversed().map((side): Control => ({
      kind: 'text',
      id: `hand-${side}`,
      text: () => console.handText(side),
      tone: () => {
        const hand = app.model.console?.hands[side];
        return hand?.wall ? 'warn' : hand?.follows ? 'good' : 'faint';
      },
    })),
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'haptics',
          label: () => 'Forces',
          on: () => console.haptics,
          press: () => console.toggleHaptics(),
          hint: 'Show contact forces by arrows, vibrations and forces of haptic pens',
        },
        { kind: 'button', id: 'swap', label: () => 'Swap the pictures', hint: 'Enlarge the small picture (V)', press: () => views.swap() },
        { kind: 'button', id: 'let-go', label: () => 'Release the hands', hint: 'Let other people or programs move the instruments', off: () => !console.pens.active, press: () => console.pens.drop() },
      ],
    },
    {
      kind: 'slider',
      id: 'motion-scale',
      label: 'Motion scale',
      hint: 'How far an instrument moves for a motion of the hand: 0.5 is half as far (– and +)',
      range: () => [console.info.scale[0] ?? 0.05, console.info.scale[1] ?? 1],
      get: () => console.scale,
      set: (v) => console.setScale(v),
      show: (v) => v.toFixed(2),
    },
    ...tools(app, console),
    { kind: 'text', id: 'forces', text: () => console.forces.text() },
    ...stereo,
    { kind: 'text', id: 'rate', tone: () => 'faint', text: () => rateText(app.model.console) },
    { kind: 'text', id: 'packets', text: () => packetText(app.model.console) },
    {
      kind: 'text',
      id: 'mqtt',
      text: () => mqttText(app.model.console?.mqtt ?? null),
      tone: () => (app.model.console?.mqtt?.problem ? 'warn' : 'plain'),
    },
    { kind: 'text', id: 'pad', tone: () => 'faint', text: () => (console.pad.name ? `Gamepad: ${console.pad.name}` : '') },
    ...taskControls(app),
    { kind: 'text', id: 'more', tone: () => 'faint', text: () => (desk() ? 'Mouse, touch, keys, gamepad, headset, other programs: behind ?' : '') },
  ];
  return { id: 'console', label: 'Console', hint: 'Hands, motion scale, tools and tasks', controls };
}

/** Return the controls for the tools of the instruments and for the fulcrum; in a headset, there is no window of tools. */
function tools(app: App, console: Console): Control[] {
  const { info } = console;
  const choices = info.tools.length ? SIDES.toReversed() : [];
  const out: Control[] = choices.map((side) => ({
    kind: 'choice',
    id: `tool-${side}`,
    label: `Tool of the ${side} hand`,
    hint: `Choose what the ${side} hand holds`,
    options: () => info.tools.map((t) => [t.name, t.title]),
    get: () => app.model.console?.hands[side]?.tool ?? '',
    set: (name) => console.takeTool(side, name),
  }));
  if (!info.fulcrum) return out;
  const button: Button = {
    kind: 'button',
    id: 'fulcrum',
    label: () => console.fulcrumText(),
    on: () => app.model.console?.fulcrum === 'direct',
    press: () => console.toggleFulcrum(),
    hint: 'Choose whether the hands move the tips or the outer ends of the instruments, which pivot in their ports',
  };
  return [...out, { kind: 'row', items: [button] }];
}

/** Return the tasks of the scene as controls; none if the server shows only one exercise. */
function taskControls(app: App): Control[] {
  const buttons = taskButtons(app);
  if (!buttons.length) return [];
  // on a screen, the list below the title has the tasks while there is none; a headset does not show this list
  const shown = () => app.xr.presenting || app.console?.info.choice?.present !== null;
  return [
    { kind: 'head', text: 'Tasks', shown },
    ...buttons.map((button): Control => ({ kind: 'row', items: [button], shown })),
  ];
}

/** Return a text on a simulation that is slower than real time; otherwise "". */
function rateText(state: ConsoleState | null): string {
  return state && state.rate < 0.8 ? `Simulated at ${state.rate}× real time` : '';
}

function packetText(state: ConsoleState | null): string {
  const packets = state?.packets;
  if (!packets) return '';
  const hands = SIDES.map((s) => {
    const from = packets.from[s];
    return `${s} hand: ${from ? `from ${from}` : 'no sender'}, ${packets.lost[s]} packets lost`;
  });
  return [`UDP packets: port ${packets.port}${state.owner === UDP ? ', in control of the hands' : ''}`, ...hands, `${packets.ignored} packets ignored`].join('\n');
}

function mqttText(mqtt: MqttState | null): string {
  if (!mqtt) return '';
  if (mqtt.problem) return mqtt.problem;
  return `Motion scale by MQTT: ${mqtt.connected ? '' : 'connecting, '}${mqtt.topic}/set at ${mqtt.broker}`;
}
