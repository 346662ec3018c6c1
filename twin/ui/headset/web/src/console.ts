/** The console of a scene: what leads the two hands, what is seen, and what is said of it. */

import { Vector3 } from 'three';
import type { App } from './app';
import { ConsoleMouse } from './console_mouse';
import { Keys } from './keys';
import type { Status } from './model';
import { Pad } from './pad';
import { Pens, SIDES } from './pens';
import { type CameraInfo, type ConsoleInfo, type SceneInfo, type Side, UDP } from './protocol';
import { Views } from './views';

/** m from the lens to what is worked at: there a tool goes with the mouse at the scale that a session begins with. */
const REACH = 0.08;
const FIRST_SCALE = 0.5;
/** The camera is dragged with a fifth of the hands' way, from its remote centre. */
const CAMERA_GAIN = 2.5;

export class Console {
  readonly pens: Pens;
  readonly views: Views;
  readonly keys: Keys;
  readonly pad: Pad;
  /** Which hand the mouse leads, or led last. */
  chosen: Side = 'right';
  readonly help =
    'Drag in the endoscope’s picture: the instrument beside the mouse follows. Right button: camera. Wheel: depth. Shift: turn.';

  constructor(
    private readonly app: App,
    scene: SceneInfo,
    readonly info: ConsoleInfo,
  ) {
    const { model, line } = app;
    this.pens = new Pens(
      line,
      () => model.console,
      () => model.client,
    );
    const camera = scene.cameras.find((c) => c.name === info.camera) as CameraInfo;
    this.views = new Views(app, camera, document.getElementById('page') as HTMLElement);
    this.keys = new Keys(this);
    this.pad = new Pad(this);
    new ConsoleMouse(app, this);
    model.atConsole = () => this.status();
  }

  /** m of a hand for one pixel of the endoscope's picture. */
  get perPixel(): number {
    return REACH / FIRST_SCALE / this.views.pixels('scope');
  }

  /** Move one hand or, while the camera is led, both; x right, y up, z out of the picture, in m. */
  move(side: Side, x: number, y: number, z: number): void {
    this.lead(side);
    if (this.pens.camera) for (const s of SIDES) this.pens[s].move(CAMERA_GAIN * x, CAMERA_GAIN * y, CAMERA_GAIN * z);
    else this.pens[side].move(x, y, z);
  }

  /** Turn one hand about axes of the picture or, while the camera is led, roll it with both hands, in rad. */
  turn(side: Side, x: number, y: number, z: number): void {
    this.lead(side);
    if (this.pens.camera) this.roll(z || -y);
    else this.pens[side].turn(x, y, z);
  }

  /** Open or close a gripper; 1 is open. */
  squeeze(side: Side, open: number): void {
    this.lead(side);
    this.pens[side].squeeze(open);
  }

  toggleJaw(side: Side): void {
    this.squeeze(side, this.pens[side].grip > 0 ? 0 : 1);
  }

  setScale(value: number): void {
    const [low, high] = this.info.scale as [number, number];
    this.app.ask('scale', { value: Math.min(high, Math.max(low, value)) });
  }

  get scale(): number {
    return this.app.model.console?.scale ?? FIRST_SCALE;
  }

  /** Each picture. */
  update(now: number): void {
    this.keys.update(now);
    this.pad.update(now);
    this.pens.say(now);
  }

  /** Tip of a hand's instrument in the scene. */
  tip(side: Side): Vector3 | null {
    const name = this.app.model.console?.hands[side].robot ?? this.info.hands[side][0];
    const member = this.app.members.find((m) => m.model.info?.name === name);
    const tool = member?.model.info?.tool;
    const node = tool && member.robot?.links.get(tool.link)?.node;
    return node ? new Vector3().fromArray(tool.T_link_tool as number[]).applyMatrix4(node.matrixWorld) : null;
  }

  /** Which limits are met now; empty if none. */
  walls(): string {
    const state = this.app.model.console;
    return state ? [...SIDES.map((s) => state.hands[s].wall), state.camera].filter(Boolean).join('; ') : '';
  }

  /** A line for each hand. */
  handText(side: Side): string {
    const hand = this.app.model.console?.hands[side];
    if (!hand) return '';
    const doing = hand.wall ? `${hand.wall}` : hand.follows ? 'follows' : 'holds still';
    return `${side === 'right' ? 'Right' : 'Left'} hand: ${hand.robot} ${doing}`;
  }

  private lead(side: Side): void {
    this.chosen = side;
    this.pens.use();
  }

  /** Turn the line between the hands, about their middle. */
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
    const packets = state.owner === UDP;
    const other = !packets && state.owner !== null && state.owner !== this.app.model.client && !state.silent;
    if (other) return { tone: 'warn', text: `Client ${state.owner} has the hands: you can watch.` };
    if (!this.pens.active && !packets) return this.broker();
    if (state.silent) return { tone: 'warn', text: `${this.missing(packets)}: nothing moves.` };
    if (state.pedal) return { tone: 'warn', text: sentence(state.pedal) };
    for (const side of SIDES) {
      const { wall, robot } = state.hands[side];
      if (wall) return { tone: 'warn', text: `${robot}: ${wall}` };
    }
    if (state.camera) return { tone: 'warn', text: `Camera: ${state.camera}` };
    if (state.rate < 0.8) return { tone: 'warn', text: `The simulation runs at ${state.rate}× real time.` };
    if (state.mode === 'nothing') return { tone: 'good', text: 'Clutch: the hands move freely, the instruments stand.' };
    if (state.mode === 'camera') return { tone: 'good', text: 'Camera: both hands drag the picture.' };
    const led = SIDES.filter((s) => state.hands[s].follows).map((s) => state.hands[s].robot);
    const who = packets ? 'UDP packets lead' : 'You lead';
    if (packets && !led.length) return { tone: 'good', text: 'UDP packets have the hands: roll a handle or open a gripper.' };
    return led.length ? { tone: 'good', text: `${who} ${led.join(' and ')}.` } : null;
  }

  /** That the broker of the motion scale is gone. */
  private broker(): Status | null {
    const mqtt = this.app.model.console?.mqtt;
    return mqtt && !mqtt.connected && mqtt.problem ? { tone: 'warn', text: mqtt.problem } : null;
  }

  /** What the server does not hear. */
  private missing(packets: boolean): string {
    const from = this.app.model.console?.packets?.from;
    if (!packets || !from) return 'The server does not hear the hands';
    const silent = SIDES.filter((s) => from[s] === null);
    return `No packets of the ${silent.join(' and the ') || 'right'} hand`;
  }
}

const sentence = (text: string): string => `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
