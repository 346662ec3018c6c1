/** What the page knows: the robot's description, the newest state and frame, and what has been said last. */

import type { Line } from './connection';
import type { Frame } from './frame';
import { HELD, REFUSED } from './frame';
import { FIRST_STATE, type Message, type Numbers, type RobotInfo, type State } from './protocol';

export interface Status {
  tone: 'plain' | 'good' | 'warn' | 'bad';
  text: string;
}

const SAID_FOR = 6000; // ms that an answer stays on the screen

export class Model {
  info: RobotInfo | null = null;
  state: State = { ...FIRST_STATE };
  frame: Frame | null = null;
  line: Line = 'connecting';
  /** This page's name at the server. */
  client: string | number | null = null;
  /** Whether this page holds the robot. */
  holding = false;
  /** Why there is no robot to see. */
  failure = '';
  onChange: () => void = () => undefined;
  /** What to do next, or nothing. */
  hint: () => string = () => '';

  private said = '';
  private saidAt = -Infinity;
  private refusedAt = -Infinity;

  /** Take over a message of the server. */
  hear(message: Message): void {
    if (message.type === 'hello') {
      this.client = message.client;
      if (this.info && message.model_hash !== this.info.model_hash)
        this.failure = 'The server now shows another robot. Load this page again.';
    } else if (message.type === 'state') {
      const { type: _, ...news } = message;
      this.state = { ...this.state, ...news };
    } else if (message.type === 'error') this.say(message.message);
    // The line is measured every two seconds: that is no reason to draw the robot.
    if (message.type !== 'pong') this.onChange();
  }

  /** Show a sentence for some seconds. */
  say(text: string): void {
    this.said = text;
    this.saidAt = performance.now();
    this.onChange();
  }

  /** A frame has come in. */
  take(frame: Frame): void {
    const before = this.frame?.flags ?? 0;
    this.frame = frame;
    // What was refused is told as long as a hand asks for it, and for some seconds after.
    if (frame.flags & REFUSED && (frame.flags & HELD || !(before & REFUSED))) this.refusedAt = performance.now();
  }

  get refused(): boolean {
    return this.frame !== null && (this.frame.flags & REFUSED) !== 0;
  }

  /** Whether somebody else holds the robot. */
  get heldByOther(): boolean {
    const held = this.frame !== null && (this.frame.flags & HELD) !== 0;
    return held && !this.holding && this.state.holder !== null && this.state.holder !== this.client;
  }

  /** Name of the protocol that is played, or will be first; empty if there is none. */
  protocol(): string {
    const first = this.info?.protocols.find((p) => p.is_default) ?? this.info?.protocols[0];
    return this.state.protocol ?? this.state.planning ?? first?.name ?? '';
  }

  /** Value of an active joint in rad or m, NaN before the first frame. */
  joint(name: string): number {
    const active = this.info?.joints.filter((j) => j.active) ?? [];
    const index = active.findIndex((j) => j.name === name);
    return index < 0 || !this.frame ? NaN : (this.frame.q[index] ?? NaN);
  }

  /** The one sentence that matters most now. */
  status(): Status {
    const s = this.state;
    if (this.failure) return { tone: 'bad', text: this.failure };
    if (this.line === 'refused')
      return {
        tone: 'bad',
        text: 'Not admitted: open the address with the token that the terminal of twin serve shows.',
      };
    if (this.line === 'reconnecting') return { tone: 'warn', text: 'Connection lost: reconnecting …' };
    if (this.line === 'connecting') return { tone: 'plain', text: 'Connecting …' };
    if (this.refused && s.reason && performance.now() - this.refusedAt < SAID_FOR)
      return { tone: 'bad', text: `Not reached: ${s.reason}` };
    if (performance.now() - this.saidAt < SAID_FOR) return { tone: 'warn', text: this.said };
    if (this.heldByOther) return { tone: 'warn', text: `Client ${s.holder} holds the robot.` };
    if (this.holding) return { tone: 'good', text: 'You hold the robot.' };
    const hint = this.hint();
    if (hint) return { tone: 'good', text: hint };
    if (s.planning) return { tone: 'plain', text: 'Planning the protocol …' };
    if (s.playing && s.phase) return { tone: 'plain', text: `Playing: ${s.phase}` };
    return { tone: 'plain', text: 'Ready.' };
  }
}

/** Return a length with a unit that suits it. */
export function length(metres: number): string {
  const size = Math.abs(metres);
  if (!Number.isFinite(metres)) return '–';
  if (size < 5e-9) return '< 0.01 µm';
  if (size < 0.99995e-3) return `${(1e6 * metres).toFixed(size < 0.99995e-5 ? 2 : 1)} µm`;
  return size < 1 ? `${(1e3 * metres).toFixed(2)} mm` : `${metres.toFixed(3)} m`;
}

/** Return a joint value in degrees or millimetres. */
export function jointValue(value: number, angle: boolean): string {
  if (!Number.isFinite(value)) return '–';
  const shown = ((angle ? 180 / Math.PI : 1e3) * value).toFixed(2).replace(/^-(?=0\.00$)/, '');
  return angle ? `${shown}°` : `${shown} mm`;
}

export function isAngle(joint: { unit: string; type: string }): boolean {
  return joint.unit === 'rad' || joint.unit === 'deg' || joint.type === 'revolute';
}

/** Return the seven numbers of a pose as an array that JSON can hold. */
export function seven(
  p: { x: number; y: number; z: number },
  q: { x: number; y: number; z: number; w: number },
): Numbers {
  return [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
}
