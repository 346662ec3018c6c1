/** What mouse, fingers, keys and other devices do at a console, for the list behind `?`. */

import type { Console } from './console';
import { TRACKED, TRACKED_PEDAL } from './console_hands';
import type { HelpPart } from './help_dialog';
import { KEYS, KEYS_PEDAL } from './keys';
import { PAD, PAD_PEDAL } from './pad';
import type { ConsoleState } from './protocol';

type Rows = readonly (readonly [what: string, how: string])[];

const TOUCH: Rows = [
  ['One finger', 'the nearest instrument follows'],
  ['Two fingers', 'move, zoom and roll the camera'],
];

const TOUCH_PEDAL: Rows = [
  ['One finger', 'the pedal is pressed, and the instrument follows'],
  ['Two fingers', 'the instrument moves; pinch for depth'],
];

const MOUSE: Rows = [
  ['Drag', 'the nearest instrument follows'],
  ['Drag with Shift', 'the instrument rotates'],
  ['Wheel', 'the instrument moves away from the lens or towards it'],
  ['Drag with the right button', 'the camera moves'],
];

const MOUSE_PEDAL: Rows = [
  ['Drag', 'the pedal is pressed, and the instrument follows'],
  ['Drag with Shift', 'the instrument rotates about the point where it enters the eye'],
  ['Wheel', 'the pedal is pressed for a moment, and the instrument moves away from the lens or towards it'],
];

/** Return the parts of the list for a console; `state` returns its newest state. */
export function consoleHelp(console: Console, state: () => ConsoleState | null): HelpPart[] {
  const { enables } = console;
  const picture = enables ? 'microscope' : 'endoscope';
  const pad: Rows = enables ? PAD_PEDAL : PAD;
  return [
    { head: `Mouse, in the ${picture}’s picture`, rows: () => (enables ? MOUSE_PEDAL : MOUSE) },
    { head: 'Touch', rows: () => (enables ? TOUCH_PEDAL : TOUCH) },
    { head: 'Keys', rows: () => [...(enables ? KEYS_PEDAL : KEYS), ['Show this list', '?']] },
    { head: 'Gamepad', rows: () => (console.pad.name ? pad : [['None', 'connect one, and press one of its buttons']]) },
    { head: 'Headset', rows: () => (enables ? TRACKED_PEDAL : TRACKED) },
    { head: 'Other programs', rows: () => programs(state()) },
  ];
}

function programs(state: ConsoleState | null): Rows {
  const hands = state?.packets ? `port ${state.packets.port}` : 'off, see twin serve --packets';
  const scale = state?.mqtt ? `${state.mqtt.topic}/set at ${state.mqtt.broker}` : 'off, see twin serve --mqtt';
  return [
    ['Hands by UDP packets', hands],
    ['Motion scale by MQTT', scale],
  ];
}
