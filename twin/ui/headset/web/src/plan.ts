/**
 * Planning mode: the ghost of the arm at the target (red if the target is not free), the planned motion, its clearance.
 * While a pedal is pressed, the hand moves the target; its release starts planning. The user then accepts or cancels.
 */

import { BufferGeometry, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments, Mesh, MeshStandardMaterial, Object3D } from 'three';
import type { App } from './app';
import type { Console } from './console';
import type { Button, Control } from './controls';
import { bytesOf } from './fields';
import { BLUE, RED } from './ink';
import type { Member } from './member';
import type { Status } from './model';
import { tube } from './overlays';
import type { Message, PlanState } from './protocol';
import { poseOf } from './robot';
import { discard } from './world';

const TAP = 250; // ms: after a shorter press, the pedal counts as pressed until it is pressed and released again
const OPACITY = 0.5;
const TREE = 0x7b8794;
const PROVEN = '#d81b2a'; // proven bound in the plot
const REST = 0.6; // s for which a preview stays at its end

export class Planning {
  /** Displays in the world frame (z up), visible in the endoscope's picture too. */
  readonly group = new Group();
  private readonly place = new Group();
  private readonly material = new MeshStandardMaterial({
    color: BLUE,
    opacity: OPACITY,
    transparent: true,
    depthWrite: false,
    polygonOffset: true, // so that the solid arm at the same place hides the ghost
    polygonOffsetFactor: 2,
    polygonOffsetUnits: 2,
  });
  private links: Object3D[] = [];
  private path: Object3D | null = null;
  private tree: LineSegments | null = null;
  private robot = '';
  private target: Float32Array = new Float32Array();
  private motion: { poses: Float32Array; every: number; duration: number; begun: number } | null = null;
  private clearance: Extract<Message, { type: 'clearance' }> | null = null;
  private readonly plot: Plot;
  private pressed = new Map<string, number>();

  constructor(
    page: HTMLElement,
    private readonly app: App,
    private readonly console: Console,
  ) {
    this.group.add(this.place);
    app.world.robotWorld.add(this.group);
    this.plot = new Plot(page);
  }

  get state(): PlanState | null {
    return this.app.model.console?.plan ?? null;
  }

  get phase(): PlanState['phase'] {
    return this.state?.phase ?? 'off';
  }

  /** Whether the arms rest or follow a plan, so that no hand moves anything. */
  get holds(): boolean {
    return this.phase === 'plan' || this.phase === 'preview' || this.phase === 'run';
  }

  // -- what the user asks for ---------------------------------------------------------------------------

  /** Press or release the pedal, which lets the hand move the target; after a tap, it stays pressed for one more press. */
  press(device: string, on: boolean): void {
    const since = this.pressed.get(device);
    if (on === (since !== undefined)) return;
    if (on) {
      const aims = this.phase === 'aim';
      this.pressed.set(device, aims ? -Infinity : performance.now());
      if (!aims) this.ask('aim');
      return;
    }
    this.pressed.delete(device);
    if (this.phase === 'aim' && performance.now() - (since as number) > TAP) this.ask('find');
  }

  /** The device is gone: its pedal counts as pressed, as after a tap. */
  forget(device: string): void {
    this.pressed.delete(device);
  }

  /** Let the hand move a target; in a preview, let it move the same target again. */
  aim(): void {
    this.ask('aim');
  }

  accept(): void {
    if (this.phase === 'preview') this.ask('accept');
  }

  cancel(): void {
    if (this.phase !== 'off') this.ask('cancel');
  }

  private ask(step: 'aim' | 'find' | 'accept' | 'cancel'): void {
    if (step === 'aim') this.console.lift();
    if (step !== 'cancel') this.console.pens.use(); // silence of the hands would end the motion
    this.app.ask('plan', { do: step, hand: this.state?.hand || this.console.chosen });
  }

  controls(): Control {
    const button = (id: string, label: () => string, press: () => void, off: () => boolean, hint: string): Button => ({ kind: 'button', id, label, press, off, hint });
    return {
      kind: 'row',
      shown: () => this.phase !== 'off',
      items: [
        button('plan-find', () => (this.phase === 'preview' ? 'Change the target' : 'Plan a motion'), () => (this.phase === 'preview' ? this.aim() : this.ask('find')), () => this.phase !== 'aim' && this.phase !== 'preview', 'Plan a motion of the arm to the target (release P)'),
        button('plan-accept', () => 'Accept', () => this.accept(), () => this.phase !== 'preview', 'Let the arm make the planned motion (Enter)'),
        button('plan-cancel', () => (this.phase === 'run' ? 'Stop' : 'Cancel'), () => this.cancel(), () => false, 'End planning; the arm stays where it is (Escape)'),
      ],
    };
  }

  /** Return the status of planning mode; null if the mode is off and there is no message about the last motion. */
  status(): Status | null {
    const { state } = this;
    if (!state) return null;
    const { said, blocked } = state;
    const robot = this.console.called(state.robot);
    if (said) return { tone: state.bad ? 'bad' : state.phase === 'off' ? 'good' : 'warn', text: said };
    if (state.phase === 'off') return null;
    if (state.phase === 'aim') {
      if (blocked) return { tone: 'warn', text: `Target of ${robot} (red): ${blocked}.` };
      const loads = state.ready ? '' : ' The geometry is being loaded.';
      return { tone: 'good', text: `Move the target of ${robot}; the target may pass through anything, and the arm is at rest. Then plan a motion.${loads}` };
    }
    if (state.phase === 'plan') return { tone: 'good', text: `Planning a motion of ${robot}: ${percent(state.done)}` };
    if (state.phase === 'run') return { tone: 'good', text: `${robot.replace(/^the/, 'The')} follows the plan: ${percent(state.done)}` };
    return { tone: 'good', text: `Motion of ${robot}, ${this.motion?.duration.toFixed(1) ?? '–'} s. ${this.clear()}Accept it, or cancel.` };
  }

  private clear(): string {
    const { clearance } = this;
    if (!clearance || clearance.proven === null) return 'The clearance is being computed. ';
    const [a, b] = clearance.bodies;
    const bodies = a && b ? ` (${a}, ${b})` : '';
    return `Minimum clearance ${mm(clearance.found ?? 0)}${bodies}, proven to be at least ${mm(clearance.proven)}. `;
  }

  // -- what the server sends ----------------------------------------------------------------------------

  hear(message: Message): void {
    if (message.type === 'target') {
      this.robot = message.robot;
      this.target = floats(message.poses);
    } else if (message.type === 'plan') this.take(message);
    else if (message.type === 'clearance') {
      this.clearance = message;
      this.plot.show(message, this.motion?.duration ?? 0);
    } else if (message.type === 'state') {
      if (this.holds && this.console.pens.active) this.console.pens.use();
    } else return;
    this.app.refresh();
  }

  private take(message: Extract<Message, { type: 'plan' }>): void {
    for (const part of [this.path, this.tree]) if (part) discard(part);
    this.path = this.tree = this.motion = this.clearance = null;
    const member = this.member(message.robot);
    if (!message.poses || !member) return;
    this.robot = message.robot;
    this.motion = { poses: floats(message.poses), every: message.every, duration: message.duration, begun: performance.now() };
    const size = 0.0006 * member.size;
    this.path = tube([...floats(message.tip)], size);
    const edges = floats(message.tree);
    if (edges.length) {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new Float32BufferAttribute(edges, 3));
      this.tree = new LineSegments(geometry, new LineBasicMaterial({ color: TREE, transparent: true, opacity: 0.55, toneMapped: false }));
      this.tree.frustumCulled = false;
    }
    this.place.add(...[this.path, this.tree].filter((o): o is Object3D => o !== null));
  }

  private member(name: string): Member | undefined {
    return this.app.members.find((m) => m.model.info?.name === name);
  }

  // -- drawing ------------------------------------------------------------------------------------------

  /** Draw the ghost at the target, or along the planned motion; called for each picture. */
  update(now: number): void {
    const { phase, app } = this;
    const was = this.group.visible;
    this.group.visible = phase !== 'off' && this.stand();
    if (this.group.visible !== was) app.world.touch();
    this.plot.place(this.console, phase === 'preview' && this.clearance !== null && !app.xr.presenting);
    if (!this.group.visible) return;
    const color = phase === 'aim' && this.state?.blocked ? RED : BLUE;
    if (this.material.color.getHex() !== color) {
      this.material.color.setHex(color);
      app.world.dirty = true;
    }
    for (const part of [this.path, this.tree]) if (part) part.visible = phase === 'preview' || (phase === 'run' && part === this.path);
    this.pose(this.shown(now));
  }

  /** Return the poses of the links that the ghost shows now. */
  private shown(now: number): Float32Array {
    const { motion } = this;
    const width = 7 * this.links.length;
    if (!motion || this.phase === 'aim' || this.phase === 'plan') return this.target;
    const count = motion.poses.length / width;
    const last = motion.poses.subarray((count - 1) * width);
    if (this.phase === 'run') return last;
    const t = ((now - motion.begun) / 1000) % (motion.duration + REST);
    const k = Math.min(count - 1, Math.floor(t / motion.every));
    this.plot.mark(Math.min(t, motion.duration));
    return motion.poses.subarray(k * width, (k + 1) * width);
  }

  private pose(poses: Float32Array): void {
    let moved = false;
    this.links.forEach((link, i) => {
      if (poses.length < 7 * (i + 1)) return;
      const { p, q } = poseOf(poses.subarray(7 * i, 7 * i + 7));
      moved ||= !link.position.equals(p) || !link.quaternion.equals(q);
      link.position.copy(p);
      link.quaternion.copy(q);
    });
    if (!moved) return;
    this.app.world.moved = performance.now();
    this.app.world.dirty = true;
  }

  /** Make the ghost of the planned arm; return whether there is one. */
  private stand(): boolean {
    const member = this.member(this.robot);
    const { robot, model } = member ?? {};
    if (!member || !robot || !model?.info || !this.target.length) return false;
    if (this.place.userData['robot'] === this.robot) return true;
    for (const link of this.links) link.removeFromParent();
    this.links = model.info.links.map((name) => {
      const link = robot.copyOf(name, BLUE, OPACITY);
      for (const part of link.children) {
        ((part as Mesh).material as MeshStandardMaterial).dispose();
        (part as Mesh).material = this.material;
      }
      link.renderOrder = 3;
      return link;
    });
    this.place.add(...this.links);
    this.place.userData['robot'] = this.robot;
    this.place.position.copy(member.place.position);
    this.place.quaternion.copy(member.place.quaternion);
    return true;
  }
}

/** Clearance over the planned motion, beside the small picture, or above it and the scoreboard. */
class Plot {
  private readonly canvas = document.createElement('canvas');
  private message: Extract<Message, { type: 'clearance' }> | null = null;
  private duration = 0;
  private at = 0;
  private shown = '';

  constructor(page: HTMLElement) {
    this.canvas.className = 'clearance';
    this.canvas.dataset['id'] = 'clearance';
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', 'Clearance over the planned motion');
    this.canvas.hidden = true;
    page.append(this.canvas);
  }

  show(message: Extract<Message, { type: 'clearance' }>, duration: number): void {
    [this.message, this.duration, this.shown] = [message, duration, ''];
  }

  mark(t: number): void {
    this.at = t;
  }

  /** Show the plot beside the small picture if there is space; never beside a window of tools. */
  place(console: Console, on: boolean): void {
    const { corner } = console.views;
    const [right] = console.views.free;
    const high = Math.min(corner.height, 130);
    let left = corner.left + corner.width + 10;
    let top = corner.top + corner.height - high;
    // A scoreboard beside the small picture has the same place: then the plot is above both.
    const board = document.querySelector('.score.across:not([hidden])')?.getBoundingClientRect();
    if (board && board.right > left && board.left < right && board.bottom > top) {
      left = corner.left;
      top = Math.round(Math.min(board.top, corner.top)) - high - 10;
    }
    const wide = Math.min(280, right - left - 12);
    this.canvas.hidden = !on || !this.message?.distance.length || wide < 110 || console.tools !== null;
    if (this.canvas.hidden) return;
    const now = `${left} ${top} ${high} ${wide} ${this.message?.distance.length} ${this.at.toFixed(2)} ${this.message?.proven}`;
    if (now === this.shown) return;
    this.shown = now;
    Object.assign(this.canvas.style, { left: `${left}px`, top: `${top}px`, width: `${wide}px`, height: `${high}px` });
    this.draw(wide, high);
  }

  private draw(wide: number, high: number): void {
    const { canvas, message } = this;
    if (!message) return;
    [canvas.width, canvas.height] = [2 * wide, 2 * high];
    const pen = canvas.getContext('2d') as CanvasRenderingContext2D;
    pen.setTransform(2, 0, 0, 2, 0, 0);
    pen.font = '11px system-ui, sans-serif';
    const top = Math.max(1e-3, 1.1 * Math.max(...message.distance, message.proven ?? 0));
    const [a, b] = [28, high - 16];
    const x = (t: number): number => 8 + (t / Math.max(this.duration, 1e-3)) * (wide - 16);
    const y = (d: number): number => b - (d / top) * (b - a);
    const least = Math.min(...message.distance, message.found ?? Infinity);
    pen.fillStyle = '#17212e';
    const title = `${wide < 260 ? 'Minimum' : 'Clearance: minimum'} ${mm(least)}`;
    pen.fillText(title, 8, 13, wide - 16);
    if (message.proven !== null) {
      pen.fillStyle = PROVEN;
      pen.fillText(`proven ${mm(message.proven)}`, 16 + pen.measureText(title).width, 13, wide - 24 - pen.measureText(title).width);
    }
    pen.fillStyle = '#55616f';
    pen.fillText(mm(top), 8, 25);
    pen.fillText('0 s', 8, high - 4);
    const end = `${this.duration.toFixed(1)} s`;
    pen.fillText(end, wide - 8 - pen.measureText(end).width, high - 4);
    const line = (color: string, points: [number, number][], dash: number[] = []): void => {
      pen.setLineDash(dash);
      pen.strokeStyle = color;
      pen.beginPath();
      for (const [t, d] of points) pen.lineTo(x(t), y(d));
      pen.stroke();
    };
    line('#9aa5b2', [[0, 0], [this.duration, 0]]);
    if (message.proven !== null) line(PROVEN, [[0, message.proven], [this.duration, message.proven]], [4, 3]);
    pen.lineWidth = 1.6;
    line('#2268c9', message.t.map((t, i) => [t, message.distance[i] ?? 0]));
    pen.lineWidth = 1;
    line('#17212e', [[this.at, 0], [this.at, top]]);
  }
}

const percent = (part: number): string => `${Math.round(100 * part)} %`;
const mm = (metres: number): string => `${(1000 * metres).toFixed(1)} mm`;

function floats(base64: string): Float32Array {
  return new Float32Array(bytesOf(base64).buffer);
}
