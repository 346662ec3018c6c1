/** The console of a scene: input devices of the two hands, views, and status. */

import { Vector3 } from 'three';
import type { App } from './app';
import { ConsoleHands } from './console_hands';
import { ConsoleMouse } from './console_mouse';
import { ConsoleTouch } from './console_touch';
import { Forces } from './forces';
import { Forms } from './forms';
import { Keys } from './keys';
import { Label } from './label';
import type { Status } from './model';
import { Pad } from './pad';
import { type Pedal, Pens, SIDES } from './pens';
import { Planning } from './plan';
import { type CameraInfo, type ConsoleInfo, type ConsoleState, type SceneInfo, type Side, UDP } from './protocol';
import { endTone } from './score';
import { Heads } from './heads';
import { Screen } from './screen';
import { ContactSound } from './sound';
import { Tools } from './tools';
import { SCOPE_LIGHT, Views } from './views';

/** Distance in m from the lens at which a tool moves exactly with the mouse, at the initial motion scale. */
const REACH = 0.08;
const FIRST_SCALE = 0.5;
const MARK = 0.001; // m: height of the number of a hole
/** ms for which the pedal remains pressed after a notch of the wheel: the tool follows with a time constant of 0.2 s. */
const AFTER_NOTCH = 800;
/** Factor on the hand motion for the camera: the scene moves by a fifth of the hand motion. */
const CAMERA_GAIN = 2.5;
/** Speed of the simulation, relative to real time, below which the page says so, and for how many ms. */
const SLOW = 0.8;
const SLOW_FOR = 8000;

export class Console {
  readonly pens: Pens;
  readonly views: Views;
  readonly keys: Keys;
  readonly pad: Pad;
  readonly screen: Screen;
  readonly heads: Heads;
  readonly hands: ConsoleHands;
  readonly forces: Forces;
  readonly plan: Planning;
  /** The window of tools; null for a scene without tools. */
  readonly tools: Tools | null;
  /** The hands that move robots. */
  readonly sides: readonly Side[];
  readonly sound: ContactSound;
  readonly forms: Forms;
  /** Hand that the mouse moves or last moved. */
  chosen: Side = 'right';
  private wheel = 0;
  /** Why the last motion of a hand ended at a limit; it is shown until the hands are used again. */
  private ended = '';
  /** Time in ms until which a slow simulation is told; NaN: it was not told yet. */
  private slowUntil = NaN;

  constructor(
    private readonly app: App,
    scene: SceneInfo,
    readonly info: ConsoleInfo,
  ) {
    const { model, line } = app;
    this.sides = SIDES.filter((s) => info.hands[s].length > 0);
    this.pens = new Pens(
      line,
      () => model.console,
      () => model.client,
      this.enables ? ['clutch'] : ['clutch', 'camera'],
    );
    const camera = scene.cameras.find((c) => c.name === info.camera) as CameraInfo;
    const page = document.getElementById('page') as HTMLElement;
    this.views = new Views(app, camera, page, info.tools.length > 0);
    this.sound = new ContactSound();
    this.forms = new Forms(page, app, info.questionnaires);
    for (const [text, at] of info.marks) this.mark(text, at);
    this.tools = info.tools.length ? new Tools(page, app, this) : null;
    this.forces = new Forces(app, this);
    this.plan = new Planning(page, app, this);
    this.keys = new Keys(this);
    this.pad = new Pad(this);
    this.screen = new Screen(app, this.views);
    this.heads = new Heads(app, this);
    this.hands = new ConsoleHands(app, this);
    new ConsoleMouse(app, this);
    new ConsoleTouch(app, this);
    model.atConsole = () => this.status();
  }

  /** Show a number above a point of the world frame, in the camera's picture only. */
  private mark(text: string, at: ArrayLike<number>): void {
    const label = new Label();
    label.say(text, '#17212e', 'normal', MARK);
    label.sprite.name = `mark ${text}`;
    label.sprite.center.set(0.5, -0.6);
    label.sprite.position.fromArray([...Array.from(at)]);
    label.sprite.layers.set(SCOPE_LIGHT);
    label.sprite.visible = true;
    this.app.world.robotWorld.add(label.sprite);
  }

  /** Whether the robot follows its hand only while the pedal is pressed; such a console has one hand and a fixed camera. */
  get enables(): boolean {
    return this.info.pedal === 'enable';
  }

  get help(): string {
    return this.enables
      ? 'Drag in the picture: the instrument follows. More behind ?'
      : 'Drag in the picture: the nearest instrument follows. More behind ?';
  }

  /** Hand motion in m for one pixel of the camera's picture. */
  get perPixel(): number {
    const scale = this.enables ? this.info.first_scale : FIRST_SCALE;
    return this.reach / scale / this.views.pixels('scope');
  }

  /** Distance in m from the lens at which a tool moves with the mouse; a fixed camera has its own. */
  private get reach(): number {
    const tip = this.enables ? this.tip('right') : null;
    return tip ? tip.distanceTo(this.views.scope.getWorldPosition(new Vector3())) / this.views.scope.matrixWorld.getMaxScaleOnAxis() : REACH;
  }

  /** Press or release the pedal that lets a robot follow, for a mouse or a finger; at other consoles, it does nothing. */
  enable(device: string, on: boolean): void {
    if (this.enables) this.pens.press('clutch', device, on);
  }

  /** Move a hand by a notch of a wheel, with the pedal pressed for a moment if the robot needs it. */
  notch(side: Side, turn: boolean, by: number, way: number, roll: number): void {
    if (this.enables && !this.pens.clutch) this.pens.press('clutch', 'wheel', true);
    if (this.pens.presses('clutch', 'wheel')) {
      window.clearTimeout(this.wheel);
      this.wheel = window.setTimeout(() => this.pens.press('clutch', 'wheel', false), AFTER_NOTCH);
    }
    if (turn) this.turn(side, 0, 0, -roll * by);
    else this.move(side, 0, 0, way * by);
  }

  /** Move one hand, or both while the camera pedal is pressed; x right, y up, z out of the picture, in m. */
  move(side: Side, x: number, y: number, z: number): void {
    this.lead(side);
    if (this.pens.camera) for (const s of SIDES) this.pens[s].move(CAMERA_GAIN * x, CAMERA_GAIN * y, CAMERA_GAIN * z);
    else this.pens[side].move(x, y, z);
  }

  /** Rotate one hand about the picture's axes, in rad; while the camera pedal is pressed, roll the camera. */
  turn(side: Side, x: number, y: number, z: number): void {
    this.lead(side);
    if (this.pens.camera) this.roll(z || -y);
    else this.pens[side].turn(x, y, z);
  }

  /** While the camera pedal is pressed, divide the distance from the lens to the working point by a factor. */
  zoom(factor: number): void {
    this.move(this.chosen, 0, 0, (REACH / FIRST_SCALE) * (1 - 1 / factor));
  }

  /** Return the hand whose instrument appears nearest to a point of the page; in planning mode, the hand of the target. */
  nearest(x: number, y: number): Side {
    if (this.sides.length === 1) return 'right';
    const planned = this.plan.state?.hand;
    if (planned) return planned;
    const away = (side: Side) => {
      const tip = this.tip(side);
      if (!tip) return Infinity;
      const at = this.views.project(tip, 'scope', x);
      return Math.hypot(at.x - x, at.y - y);
    };
    return away('right') <= away('left') ? 'right' : 'left';
  }

  /** Whether a point of the page is in the endoscope's picture; false in a headset. */
  works(x: number, y: number): boolean {
    return !this.app.xr.presenting && this.views.at(x, y) === 'scope';
  }

  /** Toggle a pedal with the button of the page. */
  toggle(pedal: Pedal): void {
    const on = !this.pens.presses(pedal, 'button');
    if (on) this.lift(); // one button at a time: clutch, camera or planning mode
    this.pens.press(pedal, 'button', on);
  }

  /** Release the pedals that the buttons of the page hold down. */
  lift(): void {
    for (const pedal of ['clutch', 'camera'] as const) this.pens.press(pedal, 'button', false);
  }

  /** Return what people call the instrument of a robot. */
  called(robot: string): string {
    return this.info.called[robot] ?? robot;
  }

  /** Open or close a gripper; 1 is open. */
  squeeze(side: Side, open: number): void {
    this.lead(side);
    this.pens[side].squeeze(open);
  }

  /** Return a label for the gripper of a hand: it closes jaws, or switches energy on. */
  jawLabel(side: Side): string {
    const name = side === 'right' ? 'Right' : 'Left';
    const carried = this.app.model.console?.hands[side]?.carries;
    const burns = this.info.tools.find((t) => t.name === carried)?.kind === 'cautery';
    return `${name} ${burns ? 'energy' : 'jaw'}`;
  }

  toggleJaw(side: Side): void {
    this.squeeze(side, this.pens[side].grip > 0 ? 0 : 1);
  }

  toggleHaptics(): void {
    this.app.ask('haptics', { on: !this.haptics });
  }

  get haptics(): boolean {
    return this.app.model.console?.haptics ?? false;
  }

  /** Let the hands move the other end of the instruments. */
  toggleFulcrum(): void {
    if (this.info.fulcrum) this.app.ask('fulcrum', { mode: this.app.model.console?.fulcrum === 'direct' ? 'compensated' : 'direct' });
  }

  /** Return a text on the end of the instruments that the hands move. */
  fulcrumText(): string {
    return this.app.model.console?.fulcrum === 'direct'
      ? 'Fulcrum direct: the tip moves against the hand'
      : 'Fulcrum compensated: the tip moves with the hand';
  }

  takeTool(side: Side, name: string): void {
    this.app.ask('tool', { hand: side, name });
  }

  /** Choose the tool after the chosen one. */
  nextTool(side: Side): void {
    const { tools } = this.info;
    const at = tools.findIndex((t) => t.name === this.app.model.console?.hands[side]?.tool);
    const next = tools[(at + 1) % tools.length];
    if (next) this.takeTool(side, next.name);
  }

  setScale(value: number): void {
    const [low, high] = this.info.scale as [number, number];
    this.app.ask('scale', { value: Math.min(high, Math.max(low, value)) });
  }

  get scale(): number {
    return this.app.model.console?.scale ?? FIRST_SCALE;
  }

  /** Update the input devices; called for each picture. */
  update(now: number): void {
    this.keys.update(now);
    this.pad.update(now);
    this.pens.say(now);
    this.forces.update();
    this.plan.update(now);
    this.sound.hear(this.app.model.console?.task ?? null);
    this.forms.refresh();
  }

  /** Return the tip of a hand's instrument in the scene; null before it is loaded. */
  tip(side: Side): Vector3 | null {
    const name = this.app.model.console?.hands[side]?.robot ?? this.info.hands[side][0];
    const member = this.app.members.find((m) => m.model.info?.name === name);
    const tool = member?.model.info?.tool;
    const node = tool && member.robot?.links.get(tool.link)?.node;
    return node ? new Vector3().fromArray(tool.T_link_tool as number[]).applyMatrix4(node.matrixWorld) : null;
  }

  /** Return how many of both hands and the camera are at a limit. */
  walls(): number {
    const state = this.app.model.console;
    return state ? [...this.sides.map((s) => state.hands[s]?.wall), state.camera].filter(Boolean).length : 0;
  }

  /** Show a message for some seconds. */
  say(text: string): void {
    this.app.model.say(text);
  }

  /** Return the status line of a hand. */
  handText(side: Side): string {
    const hand = this.app.model.console?.hands[side];
    if (!hand) return '';
    const name = capital(this.called(hand.robot).replace(/^the /, ''));
    if (hand.waits) return `${name}: ${hand.waits}`;
    const aims = this.plan.phase === 'aim' && hand.follows;
    if (hand.wall) return `${name}: ${hand.wall}`;
    return `${name} ${aims ? 'is at rest; its target follows' : hand.follows ? 'follows the hand' : 'is at rest'}`;
  }

  private lead(side: Side): void {
    this.chosen = side;
    this.pens.use();
  }

  /** Rotate the line between the hands about its midpoint. */
  private roll(angle: number): void {
    const { right, left } = this.pens;
    const middle = right.p.clone().add(left.p).divideScalar(2);
    const axis = new Vector3(0, 0, 1);
    for (const s of SIDES) {
      const off = this.pens[s].p.clone().sub(middle);
      const to = off.clone().applyAxisAngle(axis, angle).sub(off);
      this.pens[s].move(to.x, to.y, to.z);
    }
  }

  private status(): Status | null {
    const state = this.app.model.console;
    if (!state) return null;
    if (state.stopped) return { tone: 'bad', text: `The simulation has stopped: ${state.stopped}` };
    if (this.forms.due) return { tone: 'warn', text: this.forms.due };
    if (state.task?.over) return { tone: endTone(state.task), text: `${state.task.over} Press Restart to begin again.` };
    const planned = this.plan.status();
    if (planned) return planned;
    const packets = state.owner === UDP;
    const other = !packets && state.owner !== null && state.owner !== this.app.model.client && !state.silent;
    if (other) return { tone: 'warn', text: `Client ${state.owner} controls the hands: you can only watch.` };
    if (!this.pens.active && !packets) return this.broker() ?? this.atRest(state);
    const lost = packets ? [] : this.sides.filter((s) => this.pens.lost.has(s));
    if (lost.length)
      return { tone: 'warn', text: `The ${lost.join(' and the ')} hand is not tracked: nothing moves until it is tracked.` };
    if (state.silent) return { tone: 'warn', text: `${this.missing(packets)}: nothing moves.` };
    if (state.pedal) return { tone: 'warn', text: sentence(state.pedal) };
    const wall = this.atLimit(state);
    if (wall) return { tone: 'warn', text: wall };
    if (state.camera) return { tone: 'warn', text: `Camera: ${state.camera}` };
    const slow = this.slowText(state);
    if (slow) return { tone: 'plain', text: slow };
    if (state.mode === 'nothing' && this.enables)
      return { tone: 'good', text: 'The pedal is up: only the hand moves; the robot is at rest.' };
    if (state.mode === 'nothing') return { tone: 'good', text: 'Clutch: only the hands move; the instruments are at rest.' };
    if (state.mode === 'camera') return { tone: 'good', text: 'Camera: both hands move the picture.' };
    const led = this.sides.flatMap((s) => (state.hands[s]?.follows ? [this.called(state.hands[s].robot)] : []));
    const who = packets ? 'UDP packets control' : 'You control';
    if (packets && !led.length) return { tone: 'good', text: 'UDP packets control the hands: roll a handle or open a gripper to start.' };
    return led.length ? { tone: 'good', text: `${who} ${led.join(' and ')}.` } : this.nextStep(state);
  }

  /** Return the status while nobody moves a hand: why the last motion ended, or the next step of the task. */
  private atRest(state: ConsoleState): Status | null {
    return this.ended ? { tone: 'warn', text: this.ended } : this.nextStep(state);
  }

  private nextStep(state: ConsoleState): Status | null {
    return state.task?.next ? { tone: 'plain', text: state.task.next } : null;
  }

  /** Return why an instrument does not follow its hand further; "" if none is at a limit. */
  private atLimit(state: ConsoleState): string {
    for (const side of this.sides) {
      const hand = state.hands[side];
      if (!hand?.wall) continue;
      this.ended = `${capital(this.called(hand.robot))} stops: ${hand.wall}`;
      return this.ended;
    }
    this.ended = ''; // the hands are used, and nothing stops them
    return '';
  }

  /** Return a text on a simulation that is slower than real time, once for some seconds; otherwise "". */
  private slowText(state: ConsoleState): string {
    if (state.rate >= SLOW) return '';
    const now = performance.now();
    if (Number.isNaN(this.slowUntil)) this.slowUntil = now + SLOW_FOR;
    if (now > this.slowUntil) return '';
    return `This computer simulates at ${state.rate}× real time: motions take longer than in reality.`;
  }

  /** Return a warning if the MQTT broker is not connected; else null. */
  private broker(): Status | null {
    const mqtt = this.app.model.console?.mqtt;
    return mqtt && !mqtt.connected && mqtt.problem ? { tone: 'warn', text: mqtt.problem } : null;
  }

  /** Return a text on the data that the server does not receive. */
  private missing(packets: boolean): string {
    const from = this.app.model.console?.packets?.from;
    if (!packets || !from) return 'The server receives no state of the hands';
    const silent = this.sides.filter((s) => from[s] === null);
    return `No packets of the ${silent.join(' and the ') || 'right'} hand`;
  }
}

const capital = (text: string): string => `${text.charAt(0).toUpperCase()}${text.slice(1)}`;
const sentence = (text: string): string => `${capital(text)}.`;
