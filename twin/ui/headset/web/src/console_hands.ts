/** Tracked hands lead the console: what they do in the room, seen from the screen that stands there. */

import { Quaternion, Vector3 } from 'three';
import type { App } from './app';
import type { Console } from './console';
import { SIDES } from './pens';
import type { Side } from './protocol';
import { track, type Tracked } from './tracked';

const TAKE = 0.2; // opening of the gripper below which a hand takes its instrument
const FASTEST = 3; // m/s of a hand
const QUICKEST = 20; // rad/s
const LEAP = [0.03, 0.5] as const; // m and rad between two pictures that are never too much
const PULSE = [0.7, 120] as const; // strength and ms

/** What is shown in the headset. */
export const TRACKED: readonly (readonly [what: string, how: string])[] = [
  ['Begin', 'pull the trigger, or pinch'],
  ['Instruments', 'move and turn the hands'],
  ['Jaws', 'trigger, or thumb and index finger'],
  ['Clutch', 'grip button, or one fist'],
  ['Camera', 'A, X or the stick pushed in, or two fists'],
  ['Panel', 'a hand that points at it leads nothing'],
];

export class ConsoleHands {
  /** Hands that lead: those that have pulled the trigger or pinched. */
  readonly leading = new Set<Side>();
  private readonly last: Record<Side, Tracked | null> = { right: null, left: null };
  private readonly felt: Record<Side, string> = { right: '', left: '' };
  private then = 0;

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {}

  /** Each picture of a session. */
  update(frame: XRFrame, space: XRReferenceSpace, now: number): void {
    const seconds = Math.min(0.2, (now - this.then) / 1000);
    this.then = now;
    const { pens } = this.console;
    if (!pens.active) this.forget();
    const sources = [...frame.session.inputSources].filter((s) => s.targetRayMode === 'tracked-pointer');
    const source = (side: Side) => sources.find((s) => s.handedness === side);
    const seen = { right: null, left: null } as Record<Side, Tracked | null>;
    for (const side of SIDES) {
      const s = source(side);
      seen[side] = s ? track(frame, space, s) : null;
      if (this.leading.has(side) && !seen[side]) pens.lost.add(side);
      else pens.lost.delete(side);
    }
    if (!pens.lost.size) {
      this.pedals(seen);
      for (const side of SIDES) this.lead(side, seen[side], seconds);
    }
    for (const side of SIDES) {
      this.last[side] = seen[side];
      this.feel(side, source(side)?.gamepad);
    }
  }

  /** Nobody leads any more. */
  forget(): void {
    this.leading.clear();
    this.console.pens.lost.clear();
    for (const pedal of ['clutch', 'camera'] as const)
      if (this.console.pens.presses(pedal, 'headset')) this.console.pens.press(pedal, 'headset', false);
  }

  /** Only hands that lead have pedals. One fist is the clutch, two are the camera. */
  private pedals(seen: Record<Side, Tracked | null>): void {
    const hands = SIDES.flatMap((side) => (this.leading.has(side) ? [seen[side]] : []));
    const fists = hands.filter((hand) => hand?.fist).length;
    const { pens } = this.console;
    pens.press('clutch', 'headset', fists === 1 || hands.some((hand) => hand?.clutch));
    pens.press('camera', 'headset', fists === 2 || hands.some((hand) => hand?.camera));
  }

  private lead(side: Side, hand: Tracked | null, seconds: number): void {
    const last = this.last[side];
    if (!hand || !last) return;
    const begins = !this.leading.has(side);
    if (!begins) this.console.pens.use();
    if (this.app.hands.usesPanel(side)) return;
    if (begins && (hand.open > TAKE || last.open <= TAKE)) return; // the gripper must be seen to shut
    const pen = this.console.pens[side];
    this.leading.add(side);
    this.console.pens.use();
    this.console.chosen = side;
    if (!hand.fist) pen.squeeze(hand.open);
    if (begins) return; // shutting the gripper moves no instrument
    const way = hand.p.clone().sub(last.p);
    const turn = hand.q.clone().multiply(last.q.clone().invert()).normalize();
    if (turn.w < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
    const angle = 2 * Math.acos(Math.min(1, turn.w));
    // A hand cannot be that fast: it was mistaken for something else, before or now.
    if (way.length() > Math.max(LEAP[0], FASTEST * seconds) || angle > Math.max(LEAP[1], QUICKEST * seconds)) return;
    const toScreen = this.console.screen.turned(new Quaternion()).invert();
    way.applyQuaternion(toScreen);
    pen.move(way.x, way.y, way.z);
    const axis = new Vector3(turn.x, turn.y, turn.z);
    if (axis.lengthSq() > 1e-16) {
      axis.normalize().multiplyScalar(angle).applyQuaternion(toScreen);
      pen.turn(axis.x, axis.y, axis.z);
    }
  }

  /** Each limit that is new is felt once, in the hand that it stops. */
  private feel(side: Side, pad: Gamepad | undefined): void {
    const state = this.app.model.console;
    const limit = (this.leading.has(side) && (state?.hands[side].wall || state?.camera)) || '';
    const pulsing = pad as { hapticActuators?: readonly { pulse?: (value: number, ms: number) => unknown }[] } | undefined;
    if (limit && limit !== this.felt[side]) void pulsing?.hapticActuators?.[0]?.pulse?.(...PULSE);
    this.felt[side] = limit;
  }
}
