/** Gamepad: sticks move the hands, pressed sticks rotate them, triggers are grippers, bumpers are pedals; vibration. */

import type { Console } from './console';
import { SIDES } from './pens';

const DEAD = 0.15; // dead zone of a stick, as a fraction of its range
const SPEED = 0.08; // m/s: speed of the hand at the end of the stick's range
const AGAIN = 80; // ms between two commands while a force lasts; each vibrates for longer than that
const TAP = 0.2; // part of the speed at which a depth button begins, so that a short press is a small step
const RAMP = 0.5; // s until a depth button that is held moves at full speed
const BUZZ = 0.5; // strength of the vibration while the tip touches a hole
const TURN = 1.5; // rad/s: angular speed at the end of the stick's range

/** Indices of buttons and axes in the browsers' standard layout. */
const STICK = { left: 0, right: 2 } as const;
const TRIGGER = { left: 6, right: 7 } as const;
const PRESSED = { left: 10, right: 11 } as const;
const DEEPER = { left: 12, right: 3 } as const;
const NEARER = { left: 13, right: 0 } as const;
const TOOL = { left: 14, right: 2 } as const;
const PLAN = 1;
const CANCEL = 8;
const ACCEPT = 9;
const CLUTCH = 4;
const CAMERA = 5;

/** Help text next to the picture. */
export const PAD: readonly (readonly [what: string, how: string])[] = [
  ['Instruments', 'left and right stick'],
  ['Rotate', 'press the stick'],
  ['Depth', 'left: direction pad up, down; right: Y, A'],
  ['Jaws, energy', 'triggers: pull to open, or to switch on'],
  ['Next tool', 'left: direction pad left; right: X'],
  ['Clutch, camera', 'left, right bumper'],
  ['Plan a motion', 'hold B and move the target, release; Menu accepts, View cancels'],
];

/** The same for a console whose robot follows while a pedal is pressed. */
export const PAD_PEDAL: readonly (readonly [what: string, how: string])[] = [
  ['Pedal: the robot follows', 'hold a bumper'],
  ['Instrument', 'right stick'],
  ['Depth', 'right trigger deeper, left trigger back; or Y and A'],
  ['Rotate', 'left stick'],
];

export class Pad {
  /** Name of the gamepad; empty without a gamepad. */
  name = '';
  private last = 0;
  private pulled = { right: 0, left: 0 };
  /** Speed of each depth button, as a part of the full speed. */
  private depth = { right: 0, left: 0 };
  private next = { right: false, left: false };
  private decides = { cancel: false, accept: false };
  private walls = 0;
  private felt = -Infinity;

  constructor(private readonly console: Console) {}

  update(now: number): void {
    const seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const pad = navigator.getGamepads().find((p) => p?.connected && p.mapping === 'standard');
    if (!pad && this.name) this.lost();
    this.name = pad?.id ?? '';
    if (!pad) return;
    const held = (k: number) => pad.buttons[k]?.pressed ?? false;
    const value = (k: number) => pad.buttons[k]?.value ?? 0;
    const { console } = this;
    console.pens.press('clutch', 'pad', held(CLUTCH) || (console.enables && held(CAMERA)));
    console.pens.press('camera', 'pad', held(CAMERA));
    if (!console.enables) console.plan.press('pad', held(PLAN));
    if (held(CANCEL) && !this.decides.cancel) console.plan.cancel();
    if (held(ACCEPT) && !this.decides.accept) console.plan.accept();
    this.decides = { cancel: held(CANCEL), accept: held(ACCEPT) };
    for (const side of SIDES) {
      const other = !console.sides.includes(side); // a stick without a hand of its own turns the other hand
      const [x, y] = [live(pad.axes[STICK[side]]), -live(pad.axes[STICK[side] + 1])];
      const way = Number(held(NEARER[side])) - Number(held(DEEPER[side]));
      this.depth[side] = way ? Math.min(1, (this.depth[side] || TAP) + (seconds * (1 - TAP)) / RAMP) : 0;
      let z = way * this.depth[side];
      // Without jaws, the triggers move the instrument in depth, as fast as they are pulled.
      if (console.enables && !other) z += live(value(TRIGGER.left)) - live(value(TRIGGER.right));
      const [v, w] = [SPEED * seconds, TURN * seconds];
      if (x || y || z) {
        if (other && z) console.move('right', 0, 0, v * z);
        else if (other) console.turn('right', -w * y, w * x, 0);
        else if (held(PRESSED[side])) console.turn(side, -w * y, w * x, w * z);
        else console.move(side, v * x, v * y, v * z);
      }
      if (other || console.enables) continue;
      if (held(TOOL[side]) && !this.next[side]) console.nextTool(side);
      this.next[side] = held(TOOL[side]);
      const pull = value(TRIGGER[side]);
      if (Math.abs(pull - this.pulled[side]) > 0.02) {
        this.pulled[side] = pull;
        console.squeeze(side, pull);
      }
    }
    this.rumble(pad, now);
  }

  /** The gamepad is gone: its pedals are released; instruments and jaws keep their places. */
  private lost(): void {
    const { pens } = this.console;
    for (const pedal of ['clutch', 'camera'] as const) if (pens.presses(pedal, 'pad')) pens.press(pedal, 'pad', false);
    this.console.plan.forget('pad');
    for (const side of SIDES) pens[side].rest();
    this.console.say('The gamepad was disconnected: the instruments stop, and the jaws stay as they are.');
  }

  /** Vibrate once for each new limit, and as strongly as the larger force on a hand while it lasts. */
  private rumble(pad: Gamepad, now: number): void {
    const { console } = this;
    const walls = console.walls();
    const buzz = console.sound.buzzing ? BUZZ : 0;
    const size = Math.max(buzz, ...SIDES.map((side) => console.forces.strength(side)));
    if (walls > this.walls && console.haptics)
      void pad.vibrationActuator?.playEffect('dual-rumble', { duration: 150, strongMagnitude: 0.8, weakMagnitude: 0.4 });
    else if (size > 0 && now - this.felt > AGAIN) {
      this.felt = now;
      void pad.vibrationActuator?.playEffect('dual-rumble', { duration: 1.5 * AGAIN, strongMagnitude: size, weakMagnitude: size / 2 });
    }
    this.walls = walls;
  }
}

function live(axis: number | undefined): number {
  const size = Math.abs(axis ?? 0);
  return size < DEAD ? 0 : (Math.sign(axis as number) * (size - DEAD)) / (1 - DEAD);
}
