/** Hands and controllers of a headset control the console; their motions are relative to the screen in the room. */

import { Quaternion, Vector3 } from 'three';
import type { App } from './app';
import type { Console } from './console';
import { SIDES } from './pens';
import type { Side } from './protocol';
import { track, type Tracked } from './tracked';

const TAKE = 0.2; // opening of the gripper (0 to 1) below which a hand starts to control its instrument
const FASTEST = 3; // m/s: maximum plausible speed of a hand
const QUICKEST = 20; // rad/s: maximum plausible angular speed of a hand
const LEAP = [0.03, 0.5] as const; // m and rad: motion between two pictures that is always accepted
/** Fingers count as moving if a gripper's opening differs by more than this from its mean over the last `SETTLE` s. */
const FINGERS = 0.1;
const SETTLE = 0.05;
const PULSE = [0.7, 120] as const; // strength (0 to 1) and duration in ms of the vibration at a limit
const AGAIN = 60; // ms between two pulses while a force lasts

/** Help text in the headset. */
export const TRACKED: readonly (readonly [what: string, how: string])[] = [
  ['Begin', 'pull the trigger, or pinch'],
  ['Instruments', 'move and turn the hands'],
  ['Jaws', 'trigger, or thumb and index finger'],
  ['Clutch', 'grip button, or one fist'],
  ['Camera', 'A, X or the stick pushed in, or two fists'],
  ['Plan a motion', 'hold B or Y and move the target, release; then use the panel'],
  ['Panel', 'a hand that points at it moves no instrument'],
];

/** The same for a console whose robot follows while a pedal is pressed. */
export const TRACKED_PEDAL: readonly (readonly [what: string, how: string])[] = [
  ['Begin', 'pull the trigger of the right controller, or pinch'],
  ['Pedal: the robot follows', 'hold the grip button, or make a fist'],
  ['Instrument', 'move and turn the right hand'],
  ['Panel', 'a hand that points at it moves no instrument'],
];

export class ConsoleHands {
  /** Hands in control: a hand starts to control by a pull of the trigger or a pinch. */
  readonly leading = new Set<Side>();
  private readonly last: Record<Side, Tracked | null> = { right: null, left: null };
  /** Means of the grippers' openings. */
  private readonly mean: Record<Side, number> = { right: 1, left: 1 };
  private readonly felt: Record<Side, boolean> = { right: false, left: false };
  private readonly pulsed: Record<Side, number> = { right: -Infinity, left: -Infinity };
  private then = 0;

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {}

  /** Read hands and controllers; called for each picture of a session. */
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
      this.feel(side, source(side)?.gamepad, now);
    }
  }

  /** End the control by all hands, and release their pedals. */
  forget(): void {
    this.leading.clear();
    this.console.pens.lost.clear();
    this.console.plan.forget('headset');
    for (const pedal of ['clutch', 'camera'] as const)
      if (this.console.pens.presses(pedal, 'headset')) this.console.pens.press(pedal, 'headset', false);
  }

  /** Set the pedals from the hands in control: one fist is the clutch, two fists are the camera. */
  private pedals(seen: Record<Side, Tracked | null>): void {
    const hands = SIDES.flatMap((side) => (this.leading.has(side) ? [seen[side]] : []));
    const fists = hands.filter((hand) => hand?.fist).length;
    const { pens } = this.console;
    pens.press('clutch', 'headset', fists === 1 || hands.some((hand) => hand?.clutch));
    const planned = SIDES.find((side) => this.leading.has(side) && seen[side]?.plan);
    if (planned) this.console.chosen = planned;
    this.console.plan.press('headset', planned !== undefined);
    pens.press('camera', 'headset', fists === 2 || hands.some((hand) => hand?.camera));
  }

  private lead(side: Side, hand: Tracked | null, seconds: number): void {
    const last = this.last[side];
    if (!hand || !last) return;
    const begins = !this.leading.has(side);
    if (!begins) this.console.pens.use();
    if (this.app.hands.usesPanel(side)) return;
    if (begins && (hand.open > TAKE || last.open <= TAKE)) return; // a hand starts when its gripper closes
    const pen = this.console.pens[side];
    const pinches = Math.abs(hand.open - this.mean[side]) > FINGERS;
    this.mean[side] += (hand.open - this.mean[side]) * (1 - Math.exp(-seconds / SETTLE));
    this.leading.add(side);
    this.console.pens.use();
    this.console.chosen = side;
    if (!hand.fist) pen.squeeze(hand.open);
    // Fingers that pinch or pull a trigger also move the hand: that must not move the instrument.
    if (begins || pinches) return;
    const way = hand.p.clone().sub(last.p);
    const turn = hand.q.clone().multiply(last.q.clone().invert()).normalize();
    if (turn.w < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
    const angle = 2 * Math.acos(Math.min(1, turn.w));
    // A hand cannot be that fast: ignore the motion as an error of the tracking.
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

  /** Vibrate the controller once for each new limit of its arm or of the camera, and in proportion to a lasting force. */
  private feel(side: Side, pad: Gamepad | undefined, now: number): void {
    const state = this.app.model.console;
    const limit = this.console.haptics && this.leading.has(side) && Boolean(state?.hands[side]?.wall || state?.camera);
    const pulsing = pad as { hapticActuators?: readonly { pulse?: (value: number, ms: number) => unknown }[] } | undefined;
    const actuator = pulsing?.hapticActuators?.[0];
    const size = this.leading.has(side) ? this.console.forces.strength(side) : 0;
    if (limit && !this.felt[side]) void actuator?.pulse?.(...PULSE);
    else if (size > 0 && now - this.pulsed[side] > AGAIN) {
      this.pulsed[side] = now;
      void actuator?.pulse?.(size, AGAIN);
    }
    this.felt[side] = limit;
  }
}
