/** The page: loading, requests, and the drawing loop. */

import { Box3, Vector3 } from 'three';
import { Connection } from './connection';
import { Console } from './console';
import type { Sheet, Tab } from './controls';
import { Drawn } from './drawn';
import { Fields } from './fields';
import { type Field, type Frame, parseScene, sameFrame } from './frame';
import { loadEarly } from './glb';
import { Grab } from './grab';
import { Hands } from './hands';
import { Header } from './header';
import { Member } from './member';
import { Model, type RobotModel } from './model';
import { Mouse } from './mouse';
import { setAccent } from './ink';
import { type Overlays, type Shows } from './overlays';
import { DomPanel } from './panel_dom';
import { XrPanel } from './panel_xr';
import { Objects } from './objects';
import type { Hit } from './pick';
import { Place } from './place';
import type { Message, SceneInfo } from './protocol';
import { Robot } from './robot';
import { Machines } from './machines';
import { Score } from './score';
import { makeSheet } from './sheet';
import { Surroundings } from './surroundings';
import { type Look, World } from './world';
import { Xr } from './xr';

const PLANNED = new Set<Message['type']>(['target', 'plan', 'clearance']);
const STILL = 1500; // ms without motion after which pictures have full quality on slow graphics too
const PROMPT = 50; // ms after a motion within which a picture is drawn before the next display cycle

export class App {
  readonly model = new Model();
  readonly world: World;
  readonly line: Connection;
  /** Robots of the scene; one placeholder until the scene is loaded. */
  readonly members: Member[] = [];
  readonly fields = new Fields();
  readonly objects = new Objects();
  readonly surroundings: Surroundings;
  readonly drawn: Drawn;
  readonly grab: Grab;
  readonly place: Place;
  readonly xr: Xr;
  readonly hands: Hands;
  readonly xrPanel = new XrPanel();
  /** Console of a scene whose robots are controlled by two hands; null without a console. */
  console: Console | null = null;
  /** Time in ms from the start of navigation to the first picture with all robots; NaN before. */
  firstPicture = NaN;

  readonly dom: DomPanel;
  private readonly header: Header;
  private readonly mouse: Mouse;
  private readonly score: Score;
  private machines: Machines | null = null;
  private sheet: Sheet | null = null;
  private seeking = NaN;
  private seekUntil = 0;
  private stale = true;
  private loaded = false;
  /** Messages received before the scene was loaded. */
  private readonly early: Message[] = [];
  private bends: readonly Field[] = [];
  private laid: Frame | null = null;
  /** Whether the surroundings are hidden. */
  hidden = false;
  /** Whether edges are drawn, and shiny parts reflect a room. */
  rich = false;
  private refreshed = 0;
  /** Whether a picture was drawn in this display cycle. */
  private ahead = false;
  private waiting = 0;
  private due = 0;

  constructor(canvas: HTMLCanvasElement, page: HTMLElement) {
    this.world = new World(canvas);
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    this.line = new Connection(`${scheme}://${location.host}/ws`);
    this.surroundings = new Surroundings(this.world);
    this.drawn = new Drawn(this.world);
    this.world.robotWorld.add(this.fields.group, this.objects.group);
    this.join();
    this.grab = new Grab(this.world, this.members, this.line);
    this.place = new Place(this.world);
    this.xr = new Xr(this);
    this.hands = new Hands(this);
    this.header = new Header(page, this);
    this.dom = new DomPanel(page);
    this.score = new Score(page, this);
    this.mouse = new Mouse(this);
    this.world.scene.add(this.xrPanel.group);
    this.wire();
  }

  /** The active robot, to which the controls refer. */
  get member(): Member {
    return this.members[this.model.chosen] as Member;
  }

  get robot(): Robot | null {
    return this.member.robot;
  }

  get overlays(): Overlays {
    return this.member.overlays;
  }

  /** Load the robots and open the stream in parallel. */
  start(): void {
    this.line.open();
    loadEarly();
    this.world.renderer.setAnimationLoop((now, frame) => {
      this.ahead = false;
      this.picture(now, frame);
    });
    void this.xr.detect();
    this.load().catch((error: Error) => this.fail(error));
  }

  // -- requests of the controls -------------------------------------------------------------------------

  /** Send a request, and show why it is refused; the promise resolves to whether it was accepted. */
  async ask(type: string, fields: object): Promise<boolean> {
    const answer = await this.line.ask(type, this.model.robot.fields(type, fields));
    if (!answer.ok) this.model.say(answer.message);
    return answer.ok;
  }

  seek(t: number): void {
    this.seeking = t;
    this.seekUntil = performance.now() + 400;
    this.line.tell('seek', { t });
    this.refresh();
  }

  /** Time in s in the protocol: from the stream, or just after a seek the requested time. */
  clipTime(): number {
    if (performance.now() < this.seekUntil) return this.seeking;
    return this.model.time;
  }

  /** Go to the start of the next or the previous phase. */
  phase(by: 1 | -1): void {
    const t = this.clipTime();
    const starts = this.model.state.phases.map(([, a]) => a);
    const to = by > 0 ? starts.find((a) => a > t + 1e-6) : starts.findLast((a) => a < t - 0.3);
    this.seek(to ?? (by > 0 ? this.model.state.duration : 0));
  }

  show(key: keyof Shows): void {
    const on = !this.overlays.shows[key];
    // A workspace is shown for one robot; all other displays are switched for all robots together.
    for (const member of key === 'workspace' ? [this.member] : this.members) member.overlays.shows[key] = on;
    if (key === 'workspace') this.ask('workspace', { on });
    this.showAround();
  }

  /** Show or hide the surroundings according to the switches. */
  showAround(): void {
    this.surroundings.show(!this.hidden, this.overlays.shows.labels);
    this.drawn.show(this.drawn.on, !this.hidden && !this.surroundings.seeThrough);
    this.objects.show(this.overlays.shows.labels);
    this.console?.views.backdrop.forget();
    this.refresh();
  }

  /** Make another robot the active robot. */
  choose(index: number): void {
    if (index === this.model.chosen || !this.members[index]) return;
    this.model.chosen = index;
    this.build();
  }

  /** Grab the hit link or handle; its robot becomes the active robot. */
  take(hit: Hit): boolean {
    this.choose(this.members.indexOf(hit.member));
    return this.grab.start(hit);
  }

  setLook(look: Look, seeThrough = this.xr.presenting && this.xr.blend !== 'opaque'): void {
    this.world.setLook(look, seeThrough);
    for (const { robot } of this.members) robot?.brighten(look === 'additive');
    this.surroundings.brighten(look === 'additive');
    this.xrPanel.look = look;
    setAccent(look === 'additive');
    document.documentElement.dataset['look'] = look;
    this.console?.views.backdrop.forget();
    this.refresh();
  }

  /** Load what is drawn beside the measured bodies, and draw edges and reflections if the graphics are fast. */
  private async adorn(fast: boolean): Promise<void> {
    const { scene } = this.model;
    if (!scene) return;
    try {
      await this.drawn.load(scene, this.members, this.surroundings);
    } catch {
      this.model.say('The drawn parts, such as belts and drapes, could not be loaded. Reload the page to try again.');
    }
    this.showAround();
    if (fast) this.enrich(true);
  }

  /** Show or hide a person beside the robots, for scale, and fill the picture again. */
  async stand(on: boolean): Promise<void> {
    await this.drawn.stand(this.model.scene?.person, on, this.whole());
    const box = this.whole();
    const person = this.drawn.box();
    if (!person.isEmpty()) box.union(person);
    this.frameAll(box);
    this.refresh();
  }

  /** Return the bounding box of robots and surroundings in the world frame. */
  private whole(): Box3 {
    const box = new Box3();
    for (const member of this.members) box.union(member.box());
    const around = this.surroundings.box();
    if (!around.isEmpty()) box.union(around).min.setZ(Math.min(0, box.min.z));
    return box;
  }

  /** Draw edges and reflections (true), or none. */
  enrich(on: boolean): void {
    this.rich = on;
    for (const { robot } of this.members) robot?.outlineAll(on);
    this.world.reflect(on);
    this.refresh();
  }

  how(): string {
    if (!this.xr.presenting) return 'Drag with the left button. Shift rotates the tool, the wheel moves it along the view.';
    return this.hands.count
      ? 'Point at a link, then pinch or pull the trigger.'
      : 'No hand or controller is tracked: look at a link for a moment to grab it, and keep still to release it.';
  }

  /** Instruction for the next step in the headset; empty if there is none. */
  private hint(): string {
    if (!this.xr.presenting) return '';
    const act = this.hands.count ? 'pinch or pull the trigger' : 'look there for a moment';
    if (this.place.placing) return `Point at the floor and ${act}: the robot will be placed there.`;
    if (this.place.moving) return 'Pinch to move the whole robot; pinch with both hands to turn and scale it.';
    return '';
  }

  cloudText(): string {
    if (!this.overlays.shows.workspace) return '';
    const n = this.overlays.cloudCount.toLocaleString('en');
    return `Workspace in the present orientation: ${n} points${this.overlays.cloudDone ? '' : ' so far'}; blue: well conditioned, red: near a singularity.`;
  }

  lineText(): string {
    const { roundTrip, frames, reconnects } = this.line;
    const trip = Number.isFinite(roundTrip) ? `${roundTrip.toFixed(0)} ms round trip` : '';
    return `client ${this.model.client ?? '–'}, ${trip}\n${frames} frames, ${reconnects} reconnects\n${this.world.pace.text()}`;
  }

  /** Draw again after `wait` ms, unless a picture is drawn before. */
  later(wait: number): void {
    const due = performance.now() + wait;
    if (this.waiting && this.due <= due) return;
    window.clearTimeout(this.waiting);
    this.due = due;
    this.waiting = window.setTimeout(() => {
      this.waiting = 0;
      this.world.dirty = true;
    }, wait);
  }

  /** Request an update after a message; on slow graphics, a console draws pictures for frames, not for each message. */
  private inform(): void {
    this.stale = true;
    if (this.console && this.loaded && this.world.pace.slow && !this.xr.presenting) this.later(STILL);
    else this.world.dirty = true;
  }

  /** Request an update of the controls and the picture. */
  refresh(): void {
    this.stale = true;
    this.world.dirty = true;
  }

  // -- loading ------------------------------------------------------------------------------------------

  private join(): void {
    const model = this.model.robots[this.members.length] as RobotModel;
    this.members.push(new Member(this.world, model));
  }

  private async load(): Promise<void> {
    const scene = await describe();
    this.model.meet(scene);
    while (this.members.length < this.model.robots.length) this.join();
    document.title = `${scene.name} · twin`;
    this.fields.meet(scene.fields);
    if (scene.console) this.console = new Console(this, scene, scene.console);
    if (scene.machines) this.machines = new Machines(document.getElementById('page') as HTMLElement, this, scene.machines);
    for (const message of this.early.splice(0)) this.hear(message);
    this.build();
    const around = this.surroundings.load(scene);
    const robots = await Promise.all(scene.robots.map((info) => Robot.load(info)));
    await Promise.all([around, this.objects.load(scene.objects)]);
    this.adopt(scene, robots);
  }

  private adopt(scene: SceneInfo, robots: readonly Robot[]): void {
    const { world, members } = this;
    members.forEach((member, i) => member.adopt(robots[i] as Robot));
    const box = this.whole();
    world.size = box.getSize(new Vector3()).length() / 1.5;
    if (members.length > 1) for (const { overlays } of members) overlays.setSize(overlays.size, 0.013 * world.size);
    const middle = box.getCenter(new Vector3());
    world.robotWorld.position.set(-middle.x, -box.min.z, middle.y);
    this.surroundings.mark(scene, members);
    this.setLook(world.look);
    this.place.reset();
    this.frameAll(box);
    this.console?.views.mount();
    this.bend();
    this.showAround();
    world.touch();
    this.loaded = true;
  }

  /** Measure what the controls cover; return whether it has changed. */
  private cover(): boolean {
    const [right, bottom] = this.dom.covers();
    const top = this.console ? 0 : this.header.covers(window.innerWidth - right);
    return this.world.cover(this.machines?.covers() ?? this.score.covers(), right, bottom, top);
  }

  /** Set the camera so that all robots are visible. */
  private frameAll(box: Box3): void {
    this.cover();
    const size = box.getSize(new Vector3());
    this.world.frameAll(new Vector3(0, size.z / 2, 0), size.length() / 2);
  }

  /** Show the controls on the panel in the headset, with the questionnaire that is due as the first tab. */
  showPanel(form: Tab | null): void {
    if (this.sheet) this.xrPanel.show(form ? { ...this.sheet, tabs: [form, ...this.sheet.tabs] } : this.sheet);
  }

  private build(): void {
    this.sheet = makeSheet(this);
    this.dom.show(this.sheet);
    this.showPanel(this.console?.forms.tab() ?? null);
    this.refresh();
  }

  private fail(error: Error): void {
    this.model.failure = error.message;
    this.refresh();
  }

  private wire(): void {
    this.model.onChange = () => this.inform();
    this.model.hint = () => this.hint();
    this.grab.onChange = () => this.refresh();
    this.place.onChange = () => this.refresh();
    this.line.onMessage = (message) => this.hear(message);
    this.line.onFrame = () => this.arrive();
    this.world.pace.onDrawn = () => this.arrive();
    this.line.onLine = (line) => {
      this.model.line = line;
      if (line !== 'open') this.console?.pens.drop();
      if (line !== 'open' && this.grab.held) this.grab.drop('The connection was lost: the robot was released.');
      this.refresh();
    };
  }

  private hear(message: Message): void {
    const had = this.model.state.recording;
    if (!this.model.scene && PLANNED.has(message.type)) {
      this.early.push(message);
      return;
    }
    if (message.type === 'path' || message.type === 'cloud') {
      if (message.robot !== undefined && !this.model.scene) {
        this.early.push(message);
        return;
      }
      const overlays = this.members[this.model.named(message.robot)]?.overlays;
      if (message.type === 'path') overlays?.setPath(message.points);
      else if (overlays) {
        if (message.first) overlays.clearCloud();
        overlays.shows.workspace = true;
        overlays.addCloud(message.points, message.values, message.done);
      }
    }
    this.machines?.hear(message);
    if (message.type === 'forces') this.console?.forces.hear(message);
    if (message.type === 'state') this.line.hurries = message.console?.leaving ?? false;
    if (message.type === 'error' && message.code === 'released') this.grab.drop(message.message);
    this.model.hear(message);
    this.console?.plan.hear(message);
    if (message.type === 'state') {
      for (const { model, overlays } of this.members)
        if (!model.state.workspace && overlays.cloudCount) overlays.clearCloud();
      if (this.model.info && (had === undefined) !== (this.model.state.recording === undefined)) this.build();
    }
  }

  // -- the drawing loop ---------------------------------------------------------------------------------

  private picture(now: number, frame?: XRFrame): void {
    const { world } = this;
    const buffer = this.line.take();
    if (buffer) this.takeFrame(buffer);
    if (frame && this.xr.presenting) this.xr.update(frame, now);
    this.hands.update(now);
    this.mouse.update();
    this.console?.update(now);
    this.grab.update();
    if (this.stale || now - this.refreshed > 250) {
      this.stale = false;
      this.refreshed = now;
      for (const member of this.members) if (member.robot) member.overlays.update(member.model, member.robot);
      this.header.refresh();
      if (!this.xr.presenting) {
        this.dom.refresh();
        if (this.cover()) {
          if (this.console) this.console.views.place();
          else this.world.frameAgain();
        }
        this.score.refresh();
        this.machines?.refresh();
        this.console?.tools?.refresh();
      }
      if (this.loaded) this.console?.heads.refresh();
      this.xrPanel.refresh();
    }
    this.xrPanel.update(now);
    if (!this.xr.presenting && !world.dirty) return;
    if (this.xr.presenting) {
      if (this.console && this.loaded) this.console.screen.draw(now);
      world.renderer.render(world.scene, world.camera);
    } else if (!this.draw()) return;
    world.dirty = false;
  }

  /** Draw the picture of a screen; return false if the previous picture is still being drawn. */
  private draw(): boolean {
    const { world } = this;
    const { pace } = world;
    if (pace.busy) return false;
    const moving = performance.now() - world.moved < STILL;
    pace.begin(moving);
    if (moving && pace.slow) this.later(STILL);
    if (this.console && this.loaded) this.console.views.render();
    else world.renderer.render(world.scene, world.camera);
    pace.end();
    this.ahead = true;
    if (this.loaded && Number.isNaN(this.firstPicture)) {
      this.firstPicture = performance.now();
      // after the first picture, so that it does not come later; software needs much longer for such pictures
      window.setTimeout(() => void this.adorn(!pace.software));
    }
    return true;
  }

  /**
   * On slow graphics, draw a frame when it arrives, not in the next display cycle: this makes the delay shorter. Draw at
   * most one frame per cycle.
   */
  private arrive(): void {
    if (this.ahead || this.xr.presenting || !this.loaded || !this.world.pace.slow || this.world.pace.busy) return;
    const buffer = this.line.take();
    if (buffer) this.takeFrame(buffer);
    if (!this.world.dirty || performance.now() - this.world.moved > PROMPT) return;
    this.world.dirty = !this.draw();
  }

  private takeFrame(buffer: ArrayBuffer): void {
    const { model } = this;
    const before = model.robots.map((r) => r.frame);
    try {
      const scene = parseScene(buffer);
      model.take(scene);
      this.bends = scene.fields;
      this.laid = scene.robots[this.members.length] ?? null;
    } catch (error) {
      model.say((error as Error).message);
      return;
    }
    const moved = this.members.filter(({ model: m }, i) => m.frame && !sameFrame(m.frame, before[i] ?? null));
    for (const member of moved) member.follow();
    if (moved.length) this.drawn.update();
    const bent = this.bend();
    if (!moved.length && !bent) return; // an unchanged scene needs no new picture
    this.world.moved = performance.now();
    this.world.touch();
    this.stale = true;
  }

  /** Update deformables and objects from the newest frame. */
  private bend(): boolean {
    return [this.fields.update(this.bends), this.loaded && this.objects.update(this.laid)].includes(true);
  }
}

async function describe(): Promise<SceneInfo> {
  const response = await fetch('scene.json');
  if (!response.ok)
    throw new Error(
      response.status === 403
        ? 'Access denied: open the address with the token that twin serve prints on its terminal.'
        : `The server did not send the description of the scene (HTTP ${response.status}).`,
    );
  return (await response.json()) as SceneInfo;
}
