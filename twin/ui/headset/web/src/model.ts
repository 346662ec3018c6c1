/** Data of the page: description of the scene, newest state and frame, and last message. */

import type { Line } from './connection';
import { type Frame, HELD, REFUSED, type SceneFrame } from './frame';
import {
  type ConsoleState,
  FIRST_STATE,
  type Message,
  type Numbers,
  type RobotInfo,
  type SceneInfo,
  type State,
} from './protocol';

export interface Status {
  tone: 'plain' | 'good' | 'warn' | 'bad';
  text: string;
}

const SAID_FOR = 6000; // ms for which a message is shown

/** Messages for one robot; in a scene of several robots, they contain its name. */
const OF_ROBOT = new Set(['protocol', 'posture', 'undo', 'grab', 'drag', 'release', 'variant', 'distance', 'workspace']);

/** Data of one robot. */
export class RobotModel {
  info: RobotInfo | null = null;
  state: State = { ...FIRST_STATE };
  frame: Frame | null = null;
  /** Whether this page holds the robot. */
  holding = false;
  /** Time in ms of the last refused request for this robot. */
  refusedAt = -Infinity;
  /** Why the last drag of this page stopped; it is shown until the next grab or until the protocol plays. */
  stopped = '';

  constructor(readonly page: Model) {}

  /** A frame has come in. */
  take(frame: Frame): void {
    const before = this.frame?.flags ?? 0;
    this.frame = frame;
    // A refusal is shown while a grab requests the target, and for some seconds afterwards.
    if (frame.flags & REFUSED && (frame.flags & HELD || !(before & REFUSED))) this.refusedAt = performance.now();
  }

  get refused(): boolean {
    return this.frame !== null && (this.frame.flags & REFUSED) !== 0;
  }

  /** Whether another client holds the robot. */
  get heldByOther(): boolean {
    const held = this.frame !== null && (this.frame.flags & HELD) !== 0;
    return held && !this.holding && this.state.holder !== null && this.state.holder !== this.page.client;
  }

  /** Name of the robot in messages. */
  get called(): string {
    return this.page.several ? (this.info?.name ?? '') : 'the robot';
  }

  /** Name of the present or next protocol; empty if there is none. */
  protocol(): string {
    const first = this.info?.protocols.find((p) => p.is_default) ?? this.info?.protocols[0];
    return this.state.protocol ?? this.state.planning ?? first?.name ?? '';
  }

  /** Value of an active joint in rad or m; NaN before the first frame. */
  joint(name: string): number {
    const active = this.info?.joints.filter((j) => j.active) ?? [];
    const index = active.findIndex((j) => j.name === name);
    return index < 0 || !this.frame ? NaN : (this.frame.q[index] ?? NaN);
  }

  /** Return the fields of a message for this robot, with its name if the server requires it. */
  fields(type: string, fields: object): object {
    return this.page.several && OF_ROBOT.has(type) ? { robot: this.info?.name, ...fields } : fields;
  }

  say(text: string): void {
    this.page.say(text);
  }
}

export class Model {
  scene: SceneInfo | null = null;
  /** One for each robot of the scene; one placeholder until the scene is loaded. */
  readonly robots: RobotModel[] = [new RobotModel(this)];
  /** Index of the active robot, to which the controls refer. */
  chosen = 0;
  line: Line = 'connecting';
  /** Identifier of this page at the server. */
  client: string | number | null = null;
  /** Whether the server prepares other content, for which this page then reloads. */
  leaving = false;
  /** Reason why no robot is shown; empty if there is none. */
  failure = '';
  onChange: () => void = () => undefined;
  /** State of the scene's console; null without a console. */
  console: ConsoleState | null = null;
  /** Status of the console; null if there is nothing to report. */
  atConsole: () => Status | null = () => null;
  /** Instruction for the next step; empty if there is none. */
  hint: () => string = () => '';

  private news: Extract<Message, { type: 'state' }> | null = null;
  private newest: SceneFrame | null = null;
  private hash = '';
  private said = '';
  private saidAt = -Infinity;

  /** The active robot. */
  get robot(): RobotModel {
    return this.robots[this.chosen] as RobotModel;
  }

  get info(): RobotInfo | null {
    return this.robot.info;
  }

  get state(): State {
    return this.robot.state;
  }

  get frame(): Frame | null {
    return this.robot.frame;
  }

  get refused(): boolean {
    return this.robot.refused;
  }

  get heldByOther(): boolean {
    return this.robot.heldByOther;
  }

  joint(name: string): number {
    return this.robot.joint(name);
  }

  /** Whether a message must contain the name of its robot. */
  get several(): boolean {
    return this.robots.length > 1;
  }

  /** Time in s of the newest frame on the common clock. */
  get time(): number {
    return this.newest?.time ?? this.state.time;
  }

  /** Store the description of the scene. */
  meet(scene: SceneInfo): void {
    this.scene = scene;
    while (this.robots.length < scene.robots.length) this.robots.push(new RobotModel(this));
    scene.robots.forEach((info, i) => ((this.robots[i] as RobotModel).info = info));
    this.check();
    if (this.news) this.hear(this.news);
    if (this.newest) this.take(this.newest);
    this.onChange();
  }

  /** Index of the robot with this name; without a name, 0, as in a stream of one robot. */
  named(name: string | undefined): number {
    return name === undefined ? 0 : this.robots.findIndex((r) => r.info?.name === name);
  }

  /** Apply a message of the server. */
  hear(message: Message): void {
    if (message.type === 'hello') {
      this.client = message.client;
      this.hash = message.model_hash;
      this.check();
    } else if (message.type === 'state') {
      this.news = message;
      const { type: _, robots, console, ...shared } = message;
      this.console = console ?? null;
      this.leaving = console?.leaving ?? false;
      for (const robot of this.robots) {
        const own = robots?.find((r) => r.name === robot.info?.name);
        // All robots have the clock's time; a robot whose protocol has ended is at rest.
        robot.state = { ...robot.state, ...own, ...shared };
        if (robot.holding && robot.state.reason) robot.stopped = robot.state.reason;
        if (robot.state.playing) robot.stopped = '';
      }
    } else if (message.type === 'error') this.say(message.message);
    // The round-trip time is measured every two seconds; this needs no new picture.
    if (message.type !== 'pong') this.onChange();
  }

  private check(): void {
    if (!this.scene || !this.hash || this.hash === this.scene.model_hash) return;
    if (this.scene.console?.guided) window.location.reload();
    else this.failure = 'The server now shows other content. Reload this page.';
  }

  /** Show a message for some seconds. */
  say(text: string): void {
    this.said = text;
    this.saidAt = performance.now();
    this.onChange();
  }

  /** A frame has come in. */
  take(scene: SceneFrame): void {
    this.newest = scene;
    this.robots.forEach((robot, i) => {
      const frame = scene.robots[i];
      if (frame) robot.take(frame);
    });
  }

  /** Return the most important status message. */
  status(): Status {
    const s = this.state;
    if (this.failure) return { tone: 'bad', text: this.failure };
    if (this.line === 'refused')
      return {
        tone: 'bad',
        text: 'Access denied: open the address with the token that twin serve prints on its terminal.',
      };
    if (this.leaving) return { tone: 'good', text: 'The scene is being prepared: this page then shows it by itself.' };
    if (this.line === 'reconnecting') return { tone: 'warn', text: 'Connection lost: reconnecting … Nothing moves until the server answers.' };
    if (this.line === 'connecting') return { tone: 'plain', text: 'Connecting …' };
    if (this.refused && s.reason && performance.now() - this.robot.refusedAt < SAID_FOR)
      return { tone: 'bad', text: `Target not reached: ${s.reason}` };
    // Hands that still move when a task ends are refused; the end is the message, and no warning.
    const refusedByEnd = this.said.startsWith(this.console?.task?.over ?? '\0');
    if (performance.now() - this.saidAt < SAID_FOR && !refusedByEnd) return { tone: 'warn', text: this.said };
    const console = this.atConsole();
    if (console) return console;
    const failed = this.robots.find((r) => r.state.machine?.problem);
    if (failed && !s.playing) return { tone: 'bad', text: `Machine of ${failed.called}: ${failed.state.machine?.problem}.` };
    const other = this.robots.find((r) => r.heldByOther);
    if (other) return { tone: 'warn', text: `Client ${other.state.holder} holds ${other.called}.` };
    const mine = this.robots.find((r) => r.holding);
    if (mine) return { tone: 'good', text: `You hold ${mine.called}.` };
    const hint = this.hint();
    if (hint) return { tone: 'good', text: hint };
    const waits = this.robots.filter((r) => r.state.planning);
    if (waits.length)
      return {
        tone: 'plain',
        text: this.several ? `Planning: ${waits.map((r) => r.info?.name).join(', ')} …` : 'Planning the protocol …',
      };
    if (this.robot.stopped) return { tone: 'warn', text: `The last drag stopped: ${this.robot.stopped}` };
    if (s.playing && s.phase) return { tone: 'plain', text: `Playing: ${s.phase}` };
    return { tone: 'plain', text: 'Ready.' };
  }
}

/** Return a length in m as text with a suitable unit. */
export function length(metres: number): string {
  const size = Math.abs(metres);
  if (!Number.isFinite(metres)) return '–';
  if (size < 5e-9) return '< 0.01 µm';
  if (size < 0.99995e-3) return `${(1e6 * metres).toFixed(size < 0.99995e-5 ? 2 : 1)} µm`;
  return size < 1 ? `${(1e3 * metres).toFixed(2)} mm` : `${metres.toFixed(3)} m`;
}

/** Differences in m or rad below this value are rounding errors. */
const ROUNDING = 1e-9;

/** Return a difference in m, or in rad, which should be 0, as text: "exact" if it is a rounding error. */
export function difference(value: number, angle = false): string {
  if (Math.abs(value) < ROUNDING) return 'exact';
  return angle ? jointValue(value, true) : length(value);
}

/** Return a joint value in rad or m as text in degrees or millimetres. */
export function jointValue(value: number, angle: boolean): string {
  if (!Number.isFinite(value)) return '–';
  const shown = ((angle ? 180 / Math.PI : 1e3) * value).toFixed(2).replace(/^-(?=0\.00$)/, '');
  return angle ? `${shown}°` : `${shown} mm`;
}

export function isAngle(joint: { unit: string; type: string }): boolean {
  return joint.unit === 'rad' || joint.unit === 'deg' || joint.type === 'revolute';
}

/** Return the seven numbers of a pose as an array for JSON. */
export function seven(
  p: { x: number; y: number; z: number },
  q: { x: number; y: number; z: number; w: number },
): Numbers {
  return [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
}
