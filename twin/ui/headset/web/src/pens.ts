/** Two hands in the frame of the picture (x right, y up, z out of it): input devices move them, and they are sent. */

import { Quaternion, Vector3 } from 'three';
import type { Connection } from './connection';
import type { ConsoleState, Side } from './protocol';

export const SIDES: readonly Side[] = ['right', 'left'];

/** Maximum speed in m/s and rad/s, and maximum time in s counted per message; for the server, 30 mm or 0.5 rad are a jump. */
const FASTEST = 2;
const QUICKEST = 30;
const LONGEST = 0.01;
const OPEN = (40 * Math.PI) / 180; // rad: angle of an open gripper
const SQUEEZE = 4; // rad/s: maximum rate of a gripper
const EVERY = 4; // ms between two messages of hands that move
const ALIVE = 50; // ms between two messages of hands at rest
const IDLE = 5000; // ms without use after which the hands are released for other clients
const ROLL = (5 * Math.PI) / 180;

/** A handle with a gripper. */
export class Pen {
  /** Requested position. */
  readonly p = new Vector3();
  readonly q = new Quaternion();
  grip = 0;
  /** Position that was last sent. */
  readonly at = new Vector3();
  readonly turned = new Quaternion();
  gripped = 0;
  used = -Infinity;
  /** Number of the message that shows that a person holds the handle. */
  shaken = -1;

  constructor(x: number) {
    this.p.set(x, 0, 0);
    this.at.copy(this.p);
  }

  move(x: number, y: number, z: number): void {
    this.p.add(new Vector3(x, y, z));
    this.used = performance.now();
  }

  /** Rotate by a rotation vector in rad in the frame of the picture. */
  turn(x: number, y: number, z: number): void {
    const angle = Math.hypot(x, y, z);
    if (angle > 0) this.q.premultiply(new Quaternion().setFromAxisAngle(new Vector3(x, y, z).divideScalar(angle), angle));
    this.used = performance.now();
  }

  /** Set the gripper: 0 is closed, 1 is open. */
  squeeze(open: number): void {
    this.grip = OPEN * Math.min(1, Math.max(0, open));
    this.used = performance.now();
  }

  /**
   * Show that a person holds the handle: roll it by more than the server requires. Only for a hand whose tool does not
   * follow yet: the tool then keeps its attitude.
   */
  shake(number: number): void {
    this.shaken = number;
    this.q.multiply(new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), ROLL));
  }

  /** Whether all motion was sent. */
  get rests(): boolean {
    return this.p.equals(this.at) && this.q.angleTo(this.turned) < 1e-6 && this.grip === this.gripped;
  }

  /** Cancel the motion that was not yet sent. */
  rest(): void {
    this.p.copy(this.at);
    this.q.copy(this.turned);
  }

  /** Return the next state to send, after an elapsed time in s. */
  next(seconds: number): { pose: number[]; grip: number } {
    const way = this.p.clone().sub(this.at);
    const counted = Math.min(seconds, LONGEST);
    this.at.add(way.clampLength(0, FASTEST * counted));
    this.turned.rotateTowards(this.q, QUICKEST * counted).normalize();
    const off = this.grip - this.gripped;
    this.gripped += Math.sign(off) * Math.min(Math.abs(off), SQUEEZE * seconds);
    return { pose: [...this.at.toArray(), ...this.turned.toArray()], grip: this.gripped };
  }
}

export type Pedal = 'clutch' | 'camera';

export class Pens {
  readonly right = new Pen(0.08);
  readonly left = new Pen(-0.08);
  /** Whether this page sends the state of the hands. */
  active = false;
  /** Hands in control that are not tracked now; nothing is sent until they are, so that the server stops all motion. */
  readonly lost = new Set<Side>();
  /** Devices that press each pedal: keys, a gamepad, a button of the page, … */
  private readonly pressed: Readonly<Record<Pedal, Set<string>>> = { clutch: new Set(), camera: new Set() };
  private number = 0;
  private said = -Infinity;
  private used = -Infinity;
  private refused = -Infinity;
  /** Number of the first message of this use of the hands, and its time in ms. */
  private first = 0;
  private begun = 0;

  constructor(
    private readonly line: Connection,
    private readonly state: () => ConsoleState | null,
    private readonly client: () => string | number | null,
    /** Pedals that the console has. */
    private readonly pedals: readonly Pedal[] = ['clutch', 'camera'],
  ) {
    setInterval(() => this.say(performance.now()), ALIVE / 2);
    const away = () => this.drop();
    window.addEventListener('blur', away);
    document.addEventListener('visibilitychange', () => document.hidden && away());
  }

  /** Start or continue the use of the hands by this page. */
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

  /**
   * Press or release a pedal; it remains pressed while any device presses it. If it changes, motion that was not yet
   * sent is cancelled, because it would move something else now, for example instruments instead of the camera.
   */
  press(pedal: Pedal, device: string, on: boolean): void {
    if (!this.pedals.includes(pedal)) return;
    const held = this.pressed[pedal];
    const before = this[pedal];
    if (on) held.add(device);
    else if (!held.delete(device)) return;
    if (this[pedal] !== before) for (const side of SIDES) this[side].rest();
    this.use();
  }

  /** Whether this device presses a pedal. */
  presses(pedal: Pedal, device: string): boolean {
    return this.pressed[pedal].has(device);
  }

  /** Release the hands: cancel motion that was not yet sent, and notify the server. */
  drop(): void {
    this.pressed.clutch.clear();
    this.pressed.camera.clear();
    this.lost.clear();
    if (!this.active) return;
    this.active = false;
    for (const side of SIDES) this[side].rest();
    this.line.tell('release', {});
  }

  /** Whether another client controlled the hands within the last second; try again later. */
  get waits(): boolean {
    return performance.now() - this.refused < 1000;
  }

  /** Send the state of the hands: every `EVERY` ms while they move, otherwise every `ALIVE` ms. */
  say(now: number): void {
    if (!this.active) return;
    const moves = this.used > this.said || SIDES.some((side) => !this[side].rests);
    if (now - this.said < (moves ? EVERY : ALIVE)) return;
    const state = this.state();
    const other = state?.owner && state.owner !== this.client() && !state.silent;
    if (other) {
      this.refused = now;
      this.active = false;
      for (const side of SIDES) this[side].rest();
      return;
    }
    if (now - this.used > IDLE || state?.task?.over) return this.drop();
    if (this.lost.size) return;
    const rests = state?.plan && state.plan.phase !== 'off' && state.plan.phase !== 'aim';
    if (state && !rests && !state.silent && state.mode === 'instruments' && state.owner === this.client())
      for (const side of SIDES) {
        const pen = this[side];
        // Wait until the server's state is newer than the last messages; the tool may follow already.
        const answered = state.heard >= Math.max(this.first, pen.shaken);
        if (answered && state.hands[side]?.follows === false && pen.used >= this.begun) pen.shake(this.number);
      }
    const seconds = Math.min(0.1, (now - this.said) / 1000);
    this.said = now;
    const { clutch, camera } = this;
    const [right, left] = [this.right.next(seconds), this.left.next(seconds)];
    this.line.tell('hands', { number: this.number++ % 2 ** 32, right, left, clutch, camera });
  }
}
