/** The controls of a console: status of the hands, motion scale, views, and help for all input devices. */

import type { App } from './app';
import type { Console } from './console';
import type { Button, Control, Tab } from './controls';
import { TRACKED, TRACKED_PEDAL } from './console_hands';
import { KEYS, KEYS_PEDAL } from './keys';
import { PAD, PAD_PEDAL } from './pad';
import { type Pedal, SIDES } from './pens';
import { type ConsoleState, type MqttState, type Side, UDP } from './protocol';
import type { Stereo } from './views';

const STEREO: readonly [Stereo, string][] = [
  ['one', 'One picture'],
  ['side', 'Stereo: side by side'],
  ['halves', 'Stereo: halves of the window'],
  ['red-cyan', 'Stereo: red and cyan'],
  ['rows', 'Stereo: rows (polarised monitor)'],
];

const TOUCH: readonly (readonly [what: string, how: string])[] = [
  ['One finger', 'the nearest instrument follows'],
  ['Two fingers', 'move, zoom and roll the camera'],
];

const TOUCH_PEDAL: readonly (readonly [what: string, how: string])[] = [
  ['One finger', 'the pedal is pressed, and the instrument follows'],
  ['Two fingers', 'the instrument moves; pinch for depth'],
];

const MOUSE: readonly (readonly [what: string, how: string])[] = [
  ['Drag', 'the nearest instrument follows'],
  ['Drag with Shift', 'the instrument rotates'],
  ['Wheel', 'the instrument moves away from the lens or towards it'],
  ['Drag with the right button', 'the camera moves'],
];

const MOUSE_PEDAL: readonly (readonly [what: string, how: string])[] = [
  ['Drag', 'the pedal is pressed, and the instrument follows'],
  ['Drag with Shift', 'the instrument rotates about the point where it enters the eye'],
  ['Wheel', 'the pedal is pressed for a moment, and the instrument moves away from the lens or towards it'],
];

/** Return the controls that are always visible: pedals and jaws, for input devices without buttons for them. */
export function pedals(console: Console): Control {
  const pedal = (name: Pedal, label: string, hint: string): Button => ({
    kind: 'button',
    id: name,
    label: () => label,
    on: () => console.pens[name],
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
        { kind: 'button', id: 'swap', label: () => 'Swap the pictures', press: () => views.swap() },
        { kind: 'button', id: 'let-go', label: () => 'Release the hands', off: () => !console.pens.active, press: () => console.pens.drop() },
      ],
    },
    {
      kind: 'slider',
      id: 'motion-scale',
      label: 'Motion scale',
      range: () => [console.info.scale[0] ?? 0.05, console.info.scale[1] ?? 1],
      get: () => console.scale,
      set: (v) => console.setScale(v),
      show: (v) => v.toFixed(2),
    },
    ...tools(app, console),
    { kind: 'text', id: 'forces', text: () => console.forces.text() },
    ...stereo,
    { kind: 'head', text: `Mouse, in the ${enables ? 'microscope' : 'endoscope'}’s picture` },
    list('mouse', enables ? MOUSE_PEDAL : MOUSE, desk),
    { kind: 'head', text: 'Touch' },
    list('touch', enables ? TOUCH_PEDAL : TOUCH, desk),
    { kind: 'head', text: 'Keys' },
    list('keys', enables ? KEYS_PEDAL : KEYS, desk),
    { kind: 'head', text: 'Network' },
    { kind: 'text', id: 'packets', text: () => packetText(app.model.console) },
    {
      kind: 'text',
      id: 'mqtt',
      text: () => mqttText(app.model.console?.mqtt ?? null),
      tone: () => (app.model.console?.mqtt?.problem ? 'warn' : 'plain'),
    },
    { kind: 'head', text: 'Gamepad' },
    {
      kind: 'text',
      id: 'pad',
      text: () =>
        console.pad.name
          ? (enables ? PAD_PEDAL : PAD).map(([what, how]) => `${what}: ${how}`).join('\n')
          : 'No gamepad. Connect one, and press one of its buttons.',
    },
    { kind: 'head', text: 'Headset' },
    list('headset', tracked, desk),
  ];
  return { id: 'console', label: 'Console', controls };
}

/** Return the controls for the tools of the instruments and for the fulcrum; in a headset, there is no window of tools. */
function tools(app: App, console: Console): Control[] {
  const { info } = console;
  const choices = info.tools.length ? SIDES.toReversed() : [];
  const out: Control[] = choices.map((side) => ({
    kind: 'choice',
    id: `tool-${side}`,
    label: `Tool of the ${side} hand`,
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

function packetText(state: ConsoleState | null): string {
  const packets = state?.packets;
  if (!packets) return 'UDP packets: off, see twin serve --packets';
  const hands = SIDES.map((s) => {
    const from = packets.from[s];
    return `${s} hand: ${from ? `from ${from}` : 'no sender'}, ${packets.lost[s]} packets lost`;
  });
  return [`UDP packets: port ${packets.port}${state.owner === UDP ? ', in control of the hands' : ''}`, ...hands, `${packets.ignored} packets ignored`].join('\n');
}

function mqttText(mqtt: MqttState | null): string {
  if (!mqtt) return 'Motion scale by MQTT: off, see twin serve --mqtt';
  if (mqtt.problem) return mqtt.problem;
  return `Motion scale by MQTT: ${mqtt.connected ? '' : 'connecting, '}${mqtt.topic}/set at ${mqtt.broker}`;
}
