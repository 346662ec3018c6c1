/** The controls of a console: what leads what, the motion scale, the views, and the keys. */

import type { App } from './app';
import type { Console } from './console';
import type { Control, Tab } from './controls';
import { KEYS } from './keys';
import { PAD } from './pad';
import { SIDES } from './pens';
import { type ConsoleState, type MqttState, UDP } from './protocol';

export function atConsole(app: App, console: Console): Tab {
  const list = (id: string, rows: readonly (readonly [string, string])[]): Control => ({
    kind: 'text',
    id,
    text: () => rows.map(([what, how]) => `${what}: ${how}`).join('\n'),
  });
  const controls: Control[] = [
    { kind: 'head', text: 'Mouse in the endoscope’s picture' },
    list('mouse', [
      ['Drag', 'the nearest instrument follows'],
      ['Drag with Shift', 'it turns'],
      ['Wheel', 'nearer or deeper'],
      ['Drag with the right button', 'the camera'],
    ]),
    { kind: 'head', text: 'Keys' },
    list('keys', KEYS),
    { kind: 'head', text: 'Hands' },
    ...SIDES.toReversed().map((side): Control => ({
      kind: 'text',
      id: `hand-${side}`,
      text: () => console.handText(side),
      tone: () => {
        const hand = app.model.console?.hands[side];
        return hand?.wall ? 'warn' : hand?.follows ? 'good' : 'faint';
      },
    })),
    {
      kind: 'slider',
      id: 'motion-scale',
      label: 'Motion scale',
      range: () => [console.info.scale[0] ?? 0.05, console.info.scale[1] ?? 1],
      get: () => console.scale,
      set: (v) => console.setScale(v),
      show: (v) => v.toFixed(2),
    },
    {
      kind: 'row',
      items: [
        { kind: 'button', id: 'swap', label: () => 'Swap the pictures', press: () => console.views.swap() },
        { kind: 'button', id: 'let-go', label: () => 'Let go', off: () => !console.pens.active, press: () => console.pens.drop() },
      ],
    },
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
          ? PAD.map(([what, how]) => `${what}: ${how}`).join('\n')
          : 'None: connect one and press a button of it.',
    },
  ];
  return { id: 'console', label: 'Console', controls };
}

function packetText(state: ConsoleState | null): string {
  const packets = state?.packets;
  if (!packets) return 'UDP packets: off, see twin serve --packets';
  const hands = SIDES.map((s) => {
    const from = packets.from[s];
    return `${s} hand: ${from ? `from ${from}` : 'nobody'}, ${packets.lost[s]} packets lost`;
  });
  return [`UDP packets: port ${packets.port}${state.owner === UDP ? ', lead the hands' : ''}`, ...hands, `${packets.ignored} packets ignored`].join('\n');
}

function mqttText(mqtt: MqttState | null): string {
  if (!mqtt) return 'Motion scale by MQTT: off, see twin serve --mqtt';
  if (mqtt.problem) return mqtt.problem;
  return `Motion scale by MQTT: ${mqtt.connected ? '' : 'connecting, '}${mqtt.topic}/set at ${mqtt.broker}`;
}
