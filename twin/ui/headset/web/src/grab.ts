/** Holding the robot: what the hand has taken, where it leads it, and how the server's answer is shown. */

import {
  BufferGeometry,
  Group,
  Line,
  LineDashedMaterial,
  Matrix4,
  Mesh,
  Quaternion,
  SphereGeometry,
  TorusGeometry,
  Vector3,
} from 'three';
import type { Connection } from './connection';
import { Label } from './label';
import { isAngle, length, type Model, seven } from './model';
import { BLUE, flat, RED, toolPose } from './overlays';
import type { JointInfo } from './protocol';
import type { Robot } from './robot';
import type { World } from './world';

export type Mode = 'auto' | 'joint' | 'link';

interface Held {
  target: 'tool' | 'joint' | 'link';
  /** Link that is coloured. */
  link: string;
  joint?: JointInfo;
  /** Where it was taken, in the robot's world. */
  from: Vector3;
  /** In the frame of the held link. */
  local: Vector3;
  tool: { p: Vector3; q: Quaternion };
  value: number;
  last: number;
  axis: { o: Vector3; d: Vector3 };
  sent: boolean;
  granted: boolean;
}

const INTERVAL = 1000 / 70; // ms between two drags at least

export class Grab {
  mode: Mode = 'auto';
  /** Whether the tool turns with a hand or controller. */
  turning = false;
  /** A handle at the tool, that is easier to hit than the tool. */
  readonly handle = new Group();
  held: Held | null = null;
  onChange: () => void = () => undefined;

  private readonly ball: Mesh<SphereGeometry, ReturnType<typeof flat>>;
  private readonly ghostHand: Mesh;
  private readonly thread: Line;
  private readonly label = new Label();
  private wanted: Vector3 | null = null;
  private pending: object | null = null;
  private sentAt = 0;
  private hovered = '';

  constructor(
    private readonly world: World,
    private readonly model: Model,
    private readonly line: Connection,
    private robot: Robot | null = null,
  ) {
    this.ball = new Mesh(new SphereGeometry(1, 24, 16), flat(BLUE, 0.35));
    const ring = new Mesh(new TorusGeometry(1.25, 0.09, 8, 40), flat(BLUE));
    this.handle.add(this.ball, ring);
    for (const part of [this.ball, ring]) {
      part.material.depthTest = false; // the hand finds it behind the tool as well
      part.renderOrder = 4;
    }
    this.handle.visible = false;
    this.ball.userData['twinHandle'] = true;
    this.ghostHand = new Mesh(new SphereGeometry(1, 20, 12), flat(RED, 0.6));
    this.thread = new Line(
      new BufferGeometry().setFromPoints([new Vector3(), new Vector3()]),
      new LineDashedMaterial({ color: RED, depthTest: false, toneMapped: false, dashSize: 0.01, gapSize: 0.006 }),
    );
    this.thread.frustumCulled = false;
    this.thread.renderOrder = 6;
    this.ghostHand.visible = this.thread.visible = false;
    world.robotWorld.add(this.handle, this.ghostHand, this.thread, this.label.sprite);
  }

  setRobot(robot: Robot): void {
    this.robot = robot;
  }

  get target(): Mesh {
    return this.ball;
  }

  /** Which link would be taken at a hit; colours it. An empty name is nothing. */
  hover(link: string): void {
    if (this.held || !this.robot || this.hovered === link) return;
    this.hovered = link;
    this.robot.mark(link, link ? 'hover' : 'none');
    this.world.touch();
  }

  /** Take the tool (null) or a link at a point of the scene. False if that cannot be taken. */
  start(link: string | null, point: Vector3, mode: Mode = this.mode): boolean {
    const info = this.model.info;
    if (!info || !this.robot || this.held) return false;
    const name = link ?? info.tool.link;
    const tool = link === null || (mode === 'auto' && name === info.tool.link);
    const joint = !tool && mode === 'joint' ? this.drivenBy(name) : undefined;
    if (!tool && mode === 'joint' && !joint) {
      this.model.say(`No driven joint carries ${name}.`);
      return false;
    }
    return this.take(tool ? 'tool' : joint ? 'joint' : 'link', name, point, joint);
  }

  /** Take a joint by its slider. */
  startJoint(joint: JointInfo): boolean {
    return this.take('joint', joint.link, new Vector3(), joint);
  }

  private take(target: Held['target'], link: string, point: Vector3, joint?: JointInfo): boolean {
    const node = this.robot?.links.get(link)?.node;
    const pose = this.robot ? toolPose(this.model, this.robot) : null;
    if (!node || !pose || this.held) return false;
    if (this.model.line !== 'open') {
      this.model.say('There is no connection: the robot cannot be moved.');
      return false;
    }
    const from = this.toRobot(point);
    const local = from.clone().applyMatrix4(new Matrix4().compose(node.position, node.quaternion, ONE).invert());
    const tool = { p: new Vector3(), q: new Quaternion() };
    pose.decompose(tool.p, tool.q, new Vector3());
    const value = joint ? this.model.joint(joint.name) : 0;
    const held: Held = {
      target,
      link,
      joint,
      from,
      local,
      tool,
      value,
      last: 0,
      axis: this.axisOf(joint),
      sent: false,
      granted: false,
    };
    this.held = held;
    this.hovered = '';
    this.model.holding = true;
    const fields =
      target === 'tool'
        ? { target }
        : target === 'joint'
          ? { target, name: joint?.name }
          : { target, name: link, point: local.toArray() };
    void this.line.ask('grab', fields).then((answer) => {
      if (answer.ok) held.granted = true;
      else if (this.held === held) this.drop(answer.code === 'held' ? `${answer.message}.` : answer.message);
    });
    this.onChange();
    return true;
  }

  /** Lead what is held: where the taken point is now (scene), and how far the hand has turned since (scene). */
  move(point: Vector3, turn: Quaternion): void {
    const held = this.held;
    if (!held) return;
    const p = this.toRobot(point);
    this.wanted = p.clone();
    if (held.target === 'tool') {
      const Q = this.world.robotWorld.getWorldQuaternion(new Quaternion());
      const R = Q.clone().invert().multiply(turn).multiply(Q);
      const at = held.tool.p.clone().sub(held.from).applyQuaternion(R).add(p);
      const q = R.multiply(held.tool.q).normalize();
      this.pending = { pose: seven(at, q) };
      this.wanted = at;
    } else if (held.target === 'joint') this.pending = { value: this.jointValueAt(held, p) };
    else this.pending = { point: p.toArray() };
    this.flush();
  }

  /** Lead a joint that was taken by its slider. */
  moveJoint(value: number): void {
    this.wanted = null;
    this.pending = { value };
    this.flush();
  }

  end(): void {
    if (!this.held) return;
    this.flush(true);
    void this.line.ask('release');
    this.drop('');
  }

  /** The line was lost or the grab was given to another. */
  drop(why: string): void {
    this.held = null;
    this.pending = this.wanted = null;
    this.model.holding = false;
    this.robot?.mark('', 'none');
    if (why) this.model.say(why);
    this.onChange();
  }

  /** Bring handle, colours and the ghost of the hand to the newest state; send what is waiting. */
  update(): void {
    this.flush();
    const robot = this.robot;
    const pose = robot ? toolPose(this.model, robot) : null;
    if (!robot || !pose) return;
    const size = this.world.size;
    this.handle.visible = this.model.line === 'open';
    pose.decompose(this.handle.position, this.handle.quaternion, this.handle.scale);
    this.handle.scale.setScalar(0.026 * size);
    const refused = this.held !== null && this.model.refused;
    if (this.held) robot.mark(this.held.link, refused ? 'refused' : 'held');
    const color = refused ? RED : this.model.heldByOther ? 0x8a93a0 : BLUE;
    for (const part of this.handle.children) ((part as Mesh).material as ReturnType<typeof flat>).color.setHex(color);
    this.drawGhostHand(refused, pose);
  }

  private drawGhostHand(refused: boolean, tool: Matrix4): void {
    const held = this.held;
    const on = refused && held !== null && this.wanted !== null;
    this.ghostHand.visible = this.thread.visible = on;
    this.label.sprite.visible = on;
    if (!on) return;
    const size = this.world.size;
    const wanted = this.wanted as Vector3;
    const node = this.robot?.links.get(held.link)?.node;
    const is =
      held.target === 'tool' || !node
        ? new Vector3().setFromMatrixPosition(tool)
        : held.local.clone().applyMatrix4(new Matrix4().compose(node.position, node.quaternion, ONE));
    this.ghostHand.position.copy(wanted);
    this.ghostHand.scale.setScalar(0.018 * size);
    const position = this.thread.geometry.getAttribute('position');
    position.setXYZ(0, is.x, is.y, is.z);
    position.setXYZ(1, wanted.x, wanted.y, wanted.z);
    position.needsUpdate = true;
    this.thread.computeLineDistances();
    this.label.sprite.position.copy(wanted).addScaledVector(UP, 0.03 * size);
    const away = held.target === 'joint' ? '' : `\n${length(wanted.distanceTo(is))} away`;
    this.label.say(`not reached${away}`, '#b3101e', this.world.look, 0.026 * size);
  }

  private flush(now = false): void {
    const time = performance.now();
    const held = this.held;
    if (!held || !this.pending || (!now && time - this.sentAt < INTERVAL)) return;
    if (!this.line.tell('drag', this.pending)) return;
    this.sentAt = time;
    held.sent = true;
    this.pending = null;
  }

  /** The driven joint that moves a link: its own, or the nearest one on the way to the base. */
  private drivenBy(link: string): JointInfo | undefined {
    const joints = this.model.info?.joints ?? [];
    const seen = new Set<string>();
    let front = [link];
    while (front.length) {
      const here = joints.filter((j) => front.includes(j.link));
      const driven = here.find((j) => j.active);
      if (driven) return driven;
      front.forEach((name) => seen.add(name));
      front = here.map((j) => j.parent).filter((name) => !seen.has(name));
    }
    return undefined;
  }

  private axisOf(joint: JointInfo | undefined): Held['axis'] {
    const o = new Vector3();
    const d = new Vector3(0, 0, 1);
    const node = joint ? this.robot?.links.get(joint.parent)?.node : undefined;
    if (joint && node) {
      o.fromArray(joint.axis.origin).applyQuaternion(node.quaternion).add(node.position);
      d.fromArray(joint.axis.direction).applyQuaternion(node.quaternion).normalize();
    }
    return { o, d };
  }

  /** Value to which a joint must go to bring the taken point as near as it can to p. */
  private jointValueAt(held: Held, p: Vector3): number {
    const { o, d } = held.axis;
    if (!held.joint || !isAngle(held.joint)) return held.value + p.clone().sub(held.from).dot(d);
    const a = held.from.clone().sub(o).projectOnPlane(d);
    const b = p.clone().sub(o).projectOnPlane(d);
    let angle = Math.atan2(a.clone().cross(b).dot(d), a.dot(b));
    angle += 2 * Math.PI * Math.round((held.last - angle) / (2 * Math.PI)); // more than half a turn is led along
    held.last = angle;
    return held.value + angle;
  }

  private toRobot(point: Vector3): Vector3 {
    return this.world.robotWorld.worldToLocal(point.clone());
  }
}

const ONE = new Vector3(1, 1, 1);
const UP = new Vector3(0, 0, 1);
