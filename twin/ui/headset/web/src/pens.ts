/** Two hands in the picture: x right, y up, z out of it. What leads them moves them; here they become messages. */

import { Quaternion, Vector3 } from 'three';
import type { Connection } from './connection';
import type { ConsoleState, Side } from './protocol';

export const SIDES: readonly Side[] = ['right', 'left'];

/** Way in m and turn in rad within one message: the server takes 30 mm or 0.5 rad in one tick for a jump. */
const STEP = 0.02;
const TURN = 0.3;
const OPEN = (40 * Math.PI) / 180; // rad of the gripper
const SQUEEZE = 4; // rad/s
const EVERY = 10; // ms between two messages
const ALIVE = 50; // ms between two messages of hands that rest
const IDLE = 5000; // ms without any use, after which others may have the hands
const ROLL = (5 * Math.PI) / 180;

/** A handle with a gripper. */
export class Pen {
  /** Where it is to go. */
  readonly p = new Vector3();
  readonly q = new Quaternion();
  grip = 0;
  /** What was said of it last. */
  readonly at = new Vector3();
  readonly turned = new Quaternion();
  gripped = 0;
  used = -Infinity;
  /** Number of the message that shows somebody to be there. */
  shaken = -1;

  constructor(x: number) {
    this.p.set(x, 0, 0);
    this.at.copy(this.p);
  }

  move(x: number, y: number, z: number): void {
    this.p.add(new Vector3(x, y, z));
    this.used = performance.now();
  }

  /** Turn about an axis of the picture. */
  turn(x: number, y: number, z: number): void {
    const angle = Math.hypot(x, y, z);
    if (angle > 0) this.q.premultiply(new Quaternion().setFromAxisAngle(new Vector3(x, y, z).divideScalar(angle), angle));
    this.used = performance.now();
  }

  /** Open or close the gripper; 1 is open. */
  squeeze(open: number): void {
    this.grip = OPEN * Math.min(1, Math.max(0, open));
    this.used = performance.now();
  }

  /**
   * Show that somebody is there: roll the handle by more than the server asks for. Only a hand that does not lead may:
   * the tool keeps its attitude.
   */
  shake(number: number): void {
    this.shaken = number;
    this.q.multiply(new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), ROLL));
  }

  /** Stay where it was said to be. */
  rest(): void {
    this.p.copy(this.at);
    this.q.copy(this.turned);
  }

  /** The next thing to say. */
  next(seconds: number): { pose: number[]; grip: number } {
    const way = this.p.clone().sub(this.at);
    this.at.add(way.clampLength(0, STEP));
    this.turned.rotateTowards(this.q, TURN).normalize();
    const off = this.grip - this.gripped;
    this.gripped += Math.sign(off) * Math.min(Math.abs(off), SQUEEZE * seconds);
    return { pose: [...this.at.toArray(), ...this.turned.toArray()], grip: this.gripped };
  }
}

export type Pedal = 'clutch' | 'camera';

export class Pens {
  readonly right = new Pen(0.08);
  readonly left = new Pen(-0.08);
  /** Whether this page says where the hands are. */
  active = false;
  /** Hands that led and are not tracked now: nothing is said until they are, so that the server lets nothing move. */
  readonly lost = new Set<Side>();
  /** What holds each pedal down: keys, a gamepad, a button of the page, … */
  private readonly pressed: Readonly<Record<Pedal, Set<string>>> = { clutch: new Set(), camera: new Set() };
  private number = 0;
  private said = -Infinity;
  private used = -Infinity;
  private refused = -Infinity;
  /** Number of the first message, and when, since the hands were taken. */
  private first = 0;
  private begun = 0;

  constructor(
    private readonly line: Connection,
    private readonly state: () => ConsoleState | null,
    private readonly client: () => string | number | null,
  ) {
    setInterval(() => this.say(performance.now(), ALIVE), ALIVE);
    const away = () => this.drop();
    window.addEventListener('blur', away);
    document.addEventListener('visibilitychange', () => document.hidden && away());
  }

  /** Somebody uses the hands. */
  use(): void {
    this.used = performance.now();
    if (!this.active) {
      this.first = this.number;
      this.begun = this.used;
      this.right.shaken = this.left.shaken = -1;
    }
    this.active = true;
  }

  get clutch(): boolean {
    return this.pressed.clutch.size > 0;
  }

  get camera(): boolean {
    return this.pressed.camera.size > 0;
  }

  /** Press or release a pedal; it stays down while any device holds it. */
  press(pedal: Pedal, device: string, on: boolean): void {
    const held = this.pressed[pedal];
    if (on) held.add(device);
    else if (!held.delete(device)) return;
    this.use();
  }

  /** Whether this device holds a pedal. */
  presses(pedal: Pedal, device: string): boolean {
    return this.pressed[pedal].has(device);
  }

  /** Let go: what was asked for and not yet said is forgotten, and the server is told. */
  drop(): void {
    this.pressed.clutch.clear();
    this.pressed.camera.clear();
    this.lost.clear();
    if (!this.active) return;
    this.active = false;
    for (const side of SIDES) this[side].rest();
    this.line.tell('release', {});
  }

  /** Another page has the hands: ask again later. */
  get waits(): boolean {
    return performance.now() - this.refused < 1000;
  }

  /** Say where the hands are, if it is time. */
  say(now: number, every = EVERY): void {
    if (!this.active || now - this.said < every) return;
    const state = this.state();
    const other = state?.owner && state.owner !== this.client() && !state.silent;
    if (other) {
      this.refused = now;
      this.active = false;
      for (const side of SIDES) this[side].rest();
      return;
    }
    if (now - this.used > IDLE) return this.drop();
    if (this.lost.size) return;
    if (state && !state.silent && state.mode === 'instruments' && state.owner === this.client())
      for (const side of SIDES) {
        const pen = this[side];
        // What the server says must answer what this page has said since, or it may follow already.
        const answered = state.heard >= Math.max(this.first, pen.shaken);
        if (answered && !state.hands[side].follows && pen.used >= this.begun) pen.shake(this.number);
      }
    const seconds = Math.min(0.1, (now - this.said) / 1000);
    this.said = now;
    const { clutch, camera } = this;
    const [right, left] = [this.right.next(seconds), this.left.next(seconds)];
    this.line.tell('hands', { number: this.number++ % 2 ** 32, right, left, clutch, camera });
  }
}
