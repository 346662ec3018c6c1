/** Keyboard: keys for each hand, by their position on any layout; keys for pedals, scale and views. */

import type { Console } from './console';
import type { Pedal } from './pens';
import type { Side } from './protocol';

const SPEED = 0.06; // m/s: speed of the hand
const TURN = 1.2; // rad/s: angular speed of the hand

type Way = readonly [side: Side, x: number, y: number, z: number];

const WAYS: Readonly<Record<string, Way>> = {
  KeyW: ['left', 0, 1, 0],
  KeyS: ['left', 0, -1, 0],
  KeyA: ['left', -1, 0, 0],
  KeyD: ['left', 1, 0, 0],
  KeyQ: ['left', 0, 0, -1],
  KeyE: ['left', 0, 0, 1],
  KeyI: ['right', 0, 1, 0],
  KeyK: ['right', 0, -1, 0],
  KeyJ: ['right', -1, 0, 0],
  KeyL: ['right', 1, 0, 0],
  KeyU: ['right', 0, 0, -1],
  KeyO: ['right', 0, 0, 1],
};

const PEDALS: Readonly<Record<string, Pedal>> = { Space: 'clutch', KeyC: 'camera' };

const PLAN = 'KeyP';

const JAWS: Readonly<Record<string, Side>> = { KeyF: 'left', KeyH: 'right' };

/** Help text next to the picture. */
export const KEYS: readonly (readonly [what: string, keys: string])[] = [
  ['Left instrument', 'W A S D, depth Q E'],
  ['Right instrument', 'I J K L, depth U O'],
  ['Open or close the jaws', 'left F, right H'],
  ['Rotate', 'Shift with the keys of an instrument'],
  ['Camera', 'hold C with the keys of an instrument'],
  ['Clutch (instruments at rest)', 'hold Space'],
  ['Motion scale', '– and +'],
  ['Forces on or off', 'T'],
  ['Plan a motion', 'hold P and move the target, release; Enter accepts, Escape cancels'],
  ['Swap the pictures', 'V'],
  ['Fulcrum: control the tips or the outer ends', 'G'],
];

/** The same for a console whose robot follows while a pedal is pressed. */
export const KEYS_PEDAL: readonly (readonly [what: string, keys: string])[] = [
  ['Pedal: the robot follows', 'hold Space'],
  ['Instrument', 'I J K L, depth U O'],
  ['Rotate', 'Shift with these keys'],
  ['Motion scale', '– and +'],
  ['Forces on or off', 'T'],
  ['Swap the pictures', 'V'],
];

export class Keys {
  private readonly down = new Set<string>();
  private shift = false;
  private last = 0;

  constructor(private readonly console: Console) {
    window.addEventListener('keydown', (e) => this.press(e));
    window.addEventListener('keyup', (e) => this.lift(e));
    window.addEventListener('blur', () => {
      this.down.clear();
      this.console.plan.forget('keys');
    });
  }

  /** Move the hands while keys are pressed; called for each picture. */
  update(now: number): void {
    const seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    for (const code of this.down) {
      const way = WAYS[code];
      if (!way) continue;
      const [key, x, y, z] = way;
      const side = this.console.sides.includes(key) ? key : 'right';
      const [v, w] = [SPEED * seconds, TURN * seconds];
      if (this.shift) this.console.turn(side, -w * y, w * x, w * z);
      else this.console.move(side, v * x, v * y, v * z);
    }
  }

  private press(e: KeyboardEvent): void {
    const typing = e.target instanceof HTMLSelectElement; // sliders do not use letters
    const reads = document.querySelector('dialog[open]') !== null; // the list of the keys covers the picture
    if (typing || reads || e.ctrlKey || e.metaKey || e.altKey) return;
    this.shift = e.shiftKey;
    const { console } = this;
    if (PEDALS[e.code]) console.pens.press(PEDALS[e.code] as Pedal, 'keys', true);
    else if (e.key === '+' || e.key === '=') console.setScale(console.scale + 0.05);
    else if (e.key === '-') console.setScale(console.scale - 0.05);
    else if (e.code === PLAN && console.enables) return;
    else if (e.code === PLAN) console.plan.press('keys', true);
    else if (e.code === 'Enter' && console.plan.phase === 'preview' && !onButton(e)) console.plan.accept();
    else if (e.code === 'Escape' && console.plan.phase !== 'off') console.plan.cancel();
    else if (e.code === 'KeyT' && !e.repeat) console.toggleHaptics();
    else if (e.code === 'KeyG' && !e.repeat) console.toggleFulcrum();
    else if (e.code === 'KeyV' && !e.repeat) console.views.swap();
    else if (JAWS[e.code] && !e.repeat) console.toggleJaw(JAWS[e.code] as Side);
    else if (WAYS[e.code]) this.down.add(e.code);
    else return;
    e.preventDefault();
  }

  private lift(e: KeyboardEvent): void {
    this.shift = e.shiftKey;
    this.down.delete(e.code);
    if (e.code === PLAN) this.console.plan.press('keys', false);
    if (PEDALS[e.code]) this.console.pens.press(PEDALS[e.code] as Pedal, 'keys', false);
  }
}

/** Whether a key is for a button of the page. */
const onButton = (e: KeyboardEvent): boolean => e.target instanceof HTMLButtonElement;
