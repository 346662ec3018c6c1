/** The page: everything that is loaded, drawn and asked, and what happens each picture. */

import { Box3, Vector3 } from 'three';
import { Connection } from './connection';
import type { Sheet } from './controls';
import { parseFrame, sameFrame } from './frame';
import { Grab } from './grab';
import { Hands } from './hands';
import { Header } from './header';
import { Model } from './model';
import { Mouse } from './mouse';
import { Overlays, setAccent, type Shows } from './overlays';
import { DomPanel } from './panel_dom';
import { XrPanel } from './panel_xr';
import { Place } from './place';
import type { Message, RobotInfo } from './protocol';
import { Robot } from './robot';
import { makeSheet } from './sheet';
import { type Look, World } from './world';
import { Xr } from './xr';

export class App {
  readonly model = new Model();
  readonly world: World;
  readonly line: Connection;
  readonly overlays: Overlays;
  readonly grab: Grab;
  readonly place: Place;
  readonly xr: Xr;
  readonly hands: Hands;
  readonly xrPanel = new XrPanel();
  robot: Robot | null = null;
  /** ms from the start of navigation to the first picture with the robot in it; NaN before. */
  firstPicture = NaN;

  private readonly dom: DomPanel;
  private readonly header: Header;
  private readonly mouse: Mouse;
  private sheet: Sheet | null = null;
  private seeking = NaN;
  private seekUntil = 0;
  private stale = true;
  private refreshed = 0;

  constructor(canvas: HTMLCanvasElement, page: HTMLElement) {
    this.world = new World(canvas);
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    this.line = new Connection(`${scheme}://${location.host}/ws`);
    this.overlays = new Overlays(this.world);
    this.grab = new Grab(this.world, this.model, this.line);
    this.place = new Place(this.world);
    this.xr = new Xr(this);
    this.hands = new Hands(this);
    this.header = new Header(page, this);
    this.dom = new DomPanel(page);
    this.mouse = new Mouse(this);
    this.world.scene.add(this.xrPanel.group);
    this.wire();
  }

  /** Load robot and stream side by side; show each as soon as it is there. */
  start(): void {
    this.line.open();
    this.world.renderer.setAnimationLoop((now, frame) => this.picture(now, frame));
    void this.xr.detect();
    const info = describe();
    info.then(
      (about) => {
        this.model.info = about;
        document.title = `${about.name} · twin`;
        this.build();
      },
      (error: Error) => this.fail(error),
    );
    Robot.load('robot.glb', info).then(
      (robot) => this.adopt(robot),
      (error: Error) => this.fail(error),
    );
  }

  // -- what the controls ask for ------------------------------------------------------------------------

  ask(type: string, fields: object): void {
    void this.line.ask(type, fields).then((answer) => {
      if (!answer.ok) this.model.say(answer.message);
    });
  }

  seek(t: number): void {
    this.seeking = t;
    this.seekUntil = performance.now() + 400;
    this.line.tell('seek', { t });
    this.refresh();
  }

  /** Time in the protocol: as it is streamed, or as it has just been asked for. */
  clipTime(): number {
    if (performance.now() < this.seekUntil) return this.seeking;
    return this.model.frame?.clipTime ?? this.model.state.time;
  }

  /** Go to the beginning of a phase before or after this one. */
  phase(by: 1 | -1): void {
    const t = this.clipTime();
    const starts = this.model.state.phases.map(([, a]) => a);
    const to = by > 0 ? starts.find((a) => a > t + 1e-6) : starts.findLast((a) => a < t - 0.3);
    this.seek(to ?? (by > 0 ? this.model.state.duration : 0));
  }

  show(key: keyof Shows): void {
    const on = (this.overlays.shows[key] = !this.overlays.shows[key]);
    if (key === 'workspace') this.ask('workspace', { on });
    this.world.touch();
    this.refresh();
  }

  setLook(look: Look, seeThrough = this.xr.presenting && this.xr.blend !== 'opaque'): void {
    this.world.setLook(look, seeThrough);
    this.robot?.brighten(look === 'additive');
    this.xrPanel.look = look;
    setAccent(look === 'additive');
    document.documentElement.dataset['look'] = look;
    this.refresh();
  }

  how(): string {
    if (!this.xr.presenting) return 'Drag with the left button; Shift turns the tool, the wheel moves it to and fro.';
    return this.hands.count
      ? 'Pinch or pull the trigger on it.'
      : 'No hand or controller is seen: look at it for a moment to take it, keep still to let go.';
  }

  /** What to do next, in the headset. */
  private hint(): string {
    if (!this.xr.presenting) return '';
    const act = this.hands.count ? 'pinch or pull the trigger' : 'look there for a moment';
    if (this.place.placing) return `Point at the floor and ${act}: the robot will stand there.`;
    if (this.place.leading) return 'Pinch to move the whole robot; with both hands it is turned and scaled.';
    return '';
  }

  cloudText(): string {
    if (!this.overlays.shows.workspace) return '';
    const n = this.overlays.cloudCount.toLocaleString('en');
    return `Workspace in the present orientation: ${n} points${this.overlays.cloudDone ? '' : ' so far'}; blue is well conditioned, red is near a singularity.`;
  }

  lineText(): string {
    const { roundTrip, frames, reconnects } = this.line;
    const trip = Number.isFinite(roundTrip) ? `${roundTrip.toFixed(0)} ms there and back` : '';
    return `client ${this.model.client ?? '–'}, ${trip}\n${frames} frames, ${reconnects} reconnects`;
  }

  /** Something that the controls show has changed. */
  refresh(): void {
    this.stale = true;
    this.world.dirty = true;
  }

  // -- loading ------------------------------------------------------------------------------------------

  private adopt(robot: Robot): void {
    const { world, overlays, model } = this;
    const info = model.info as RobotInfo;
    this.robot = robot;
    world.robotWorld.add(robot.root);
    robot.root.rotation.set(0, 0, 0); // its turn from z-up to y-up is that of `robotWorld`, once
    if (model.frame) robot.apply(model.frame, info.links);
    const box = robot.box();
    if (info.scenery) box.min.z = Math.min(box.min.z, info.scenery.floor);
    world.size = box.getSize(new Vector3()).length() / 1.5;
    const middle = box.getCenter(new Vector3());
    world.robotWorld.position.set(-middle.x, -box.min.z, middle.y);
    this.grab.setRobot(robot);
    if (info.scenery) overlays.setScenery(info.scenery);
    robot.brighten(world.look === 'additive');
    this.place.reset();
    this.frameAll(box);
    world.touch();
    this.refresh();
  }

  /** Let the camera see the whole robot. */
  private frameAll(box: Box3): void {
    this.world.cover(...this.dom.covers());
    const size = box.getSize(new Vector3());
    this.world.frameAll(new Vector3(0, size.z / 2, 0), size.length() / 2);
  }

  private build(): void {
    this.sheet = makeSheet(this);
    this.dom.show(this.sheet);
    this.xrPanel.show(this.sheet);
    this.refresh();
  }

  private fail(error: Error): void {
    this.model.failure = error.message;
    this.refresh();
  }

  private wire(): void {
    this.model.onChange = () => this.refresh();
    this.model.hint = () => this.hint();
    this.grab.onChange = () => this.refresh();
    this.place.onChange = () => this.refresh();
    this.line.onMessage = (message) => this.hear(message);
    this.line.onLine = (line) => {
      this.model.line = line;
      if (line !== 'open' && this.grab.held) this.grab.drop('The connection was lost: the robot was let go.');
      this.refresh();
    };
  }

  private hear(message: Message): void {
    const had = this.model.state.recording;
    if (message.type === 'path') this.overlays.setPath(message.points);
    if (message.type === 'cloud') {
      if (message.first) this.overlays.clearCloud();
      this.overlays.shows.workspace = true;
      this.overlays.addCloud(message.points, message.values, message.done);
    }
    if (message.type === 'error' && message.code === 'released') this.grab.drop(message.message);
    this.model.hear(message);
    if (message.type === 'state') {
      if (!this.model.state.workspace && this.overlays.cloudCount) this.overlays.clearCloud();
      if (this.model.info && (had === undefined) !== (this.model.state.recording === undefined)) this.build();
    }
  }

  // -- each picture -------------------------------------------------------------------------------------

  private picture(now: number, frame?: XRFrame): void {
    const { world, model, robot } = this;
    const buffer = this.line.take();
    if (buffer) this.takeFrame(buffer);
    if (frame && this.xr.presenting) this.xr.update(frame, now);
    this.hands.update(now);
    this.mouse.update();
    this.grab.update();
    if (this.stale || now - this.refreshed > 250) {
      this.stale = false;
      this.refreshed = now;
      if (robot) this.overlays.update(model, robot);
      this.header.refresh();
      if (!this.xr.presenting) {
        this.dom.refresh();
        world.cover(...this.dom.covers());
      }
      this.xrPanel.refresh();
    }
    this.xrPanel.update(now);
    if (!this.xr.presenting && !world.dirty) return;
    world.dirty = false;
    world.renderer.render(world.scene, world.camera);
    if (robot && Number.isNaN(this.firstPicture)) this.firstPicture = performance.now();
  }

  private takeFrame(buffer: ArrayBuffer): void {
    const { model, robot } = this;
    let same: boolean;
    try {
      const frame = parseFrame(buffer);
      same = sameFrame(frame, model.frame);
      model.take(frame);
    } catch (error) {
      model.say((error as Error).message);
      return;
    }
    if (same) return; // a robot that stands still needs no new picture
    if (robot && model.info && model.frame) {
      robot.apply(model.frame, model.info.links);
      this.overlays.update(model, robot);
      this.world.touch();
    }
    this.stale = true;
  }
}

async function describe(): Promise<RobotInfo> {
  const response = await fetch('robot.json');
  if (!response.ok)
    throw new Error(
      response.status === 403
        ? 'Not admitted: open the address with the token that the terminal of twin serve shows.'
        : `The server does not describe its robot (${response.status}).`,
    );
  return (await response.json()) as RobotInfo;
}
