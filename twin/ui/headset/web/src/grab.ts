/** Grab and drag a robot, and show the server's response. */

import {
  BufferGeometry,
  CircleGeometry,
  DoubleSide,
  Line,
  LineDashedMaterial,
  Matrix4,
  Mesh,
  Quaternion,
  SphereGeometry,
  Vector3,
} from 'three';
import type { Connection } from './connection';
import { Label } from './label';
import type { Member } from './member';
import { isAngle, length, seven } from './model';
import { BLUE, flat, RED } from './ink';
import { toolPose } from './overlays';
import type { Hit } from './pick';
import type { JointInfo } from './protocol';
import type { World } from './world';

export type Mode = 'auto' | 'joint' | 'link';

interface Held {
  member: Member;
  target: 'tool' | 'joint' | 'link';
  /** Name of the coloured link. */
  link: string;
  joint?: JointInfo;
  /** Grabbed point in the robot's base frame. */
  from: Vector3;
  /** Grabbed point in the frame of the held link. */
  local: Vector3;
  tool: { p: Vector3; q: Quaternion };
  value: number;
  last: number;
  axis: { o: Vector3; d: Vector3 };
  sent: boolean;
  granted: boolean;
}

const INTERVAL = 1000 / 70; // minimum time in ms between two drags

export class Grab {
  mode: Mode = 'auto';
  /** Whether the tool rotates with a hand or controller. */
  turning = false;
  held: Held | null = null;
  onChange: () => void = () => undefined;

  private readonly ghostHand: Mesh;
  private readonly thread: Line;
  /** A translucent disc at the held point, across the way that a limit closes. */
  private readonly wall: Mesh;
  private readonly label = new Label();
  private wanted: Vector3 | null = null;
  private pending: object | null = null;
  private sentAt = 0;
  private hovered: Member | null = null;

  constructor(
    private readonly world: World,
    private readonly members: readonly Member[],
    private readonly line: Connection,
  ) {
    this.ghostHand = new Mesh(new SphereGeometry(1, 20, 12), flat(RED, 0.6));
    this.thread = new Line(
      new BufferGeometry().setFromPoints([new Vector3(), new Vector3()]),
      new LineDashedMaterial({ color: RED, depthTest: false, toneMapped: false, dashSize: 0.01, gapSize: 0.006 }),
    );
    this.thread.frustumCulled = false;
    this.thread.renderOrder = 6;
    const face = flat(RED, 0.3);
    face.side = DoubleSide;
    face.depthWrite = false;
    this.wall = new Mesh(new CircleGeometry(1, 48), face);
    this.wall.renderOrder = 5;
    this.ghostHand.visible = this.thread.visible = this.wall.visible = false;
  }

  /** Colour the link that a grab at this hit would hold. */
  hover(hit: Hit | null): void {
    if (this.held) return;
    const link = hit ? (hit.link ?? hit.member.model.info?.tool.link ?? '') : '';
    if (this.hovered !== (hit?.member ?? null) && this.hovered?.robot?.mark('', 'none')) this.world.touch();
    this.hovered = hit?.member ?? null;
    if (hit?.member.robot?.mark(link, link ? 'hover' : 'none')) this.world.touch();
  }

  /** Grab the tool (link null) or a link at the hit point; return false if this is not possible. */
  start({ member, link, point }: Hit, mode: Mode = this.mode): boolean {
    const info = member.model.info;
    if (!info || !member.robot || this.held) return false;
    const name = link ?? info.tool.link;
    const tool = link === null || (mode === 'auto' && name === info.tool.link);
    const joint = !tool && mode === 'joint' ? drivenBy(info.joints, name) : undefined;
    if (!tool && mode === 'joint' && !joint) {
      member.model.say(`No active joint moves ${name}.`);
      return false;
    }
    return this.take(member, tool ? 'tool' : joint ? 'joint' : 'link', name, point, joint);
  }

  /** Grab a joint by its slider. */
  startJoint(member: Member, joint: JointInfo): boolean {
    return this.take(member, 'joint', joint.link, new Vector3(), joint);
  }

  private take(member: Member, target: Held['target'], link: string, point: Vector3, joint?: JointInfo): boolean {
    const { model, robot } = member;
    const node = robot?.links.get(link)?.node;
    const pose = robot ? toolPose(model, robot) : null;
    if (!node || !pose || this.held) return false;
    if (model.page.line !== 'open') {
      model.say('There is no connection: the robot cannot be moved.');
      return false;
    }
    const from = member.place.worldToLocal(point.clone());
    const local = from.clone().applyMatrix4(new Matrix4().compose(node.position, node.quaternion, ONE).invert());
    const tool = { p: new Vector3(), q: new Quaternion() };
    pose.decompose(tool.p, tool.q, new Vector3());
    const value = joint ? model.joint(joint.name) : 0;
    const held: Held = {
      member,
      target,
      link,
      joint,
      from,
      local,
      tool,
      value,
      last: 0,
      axis: axisOf(member, joint),
      sent: false,
      granted: false,
    };
    this.held = held;
    this.hovered = null;
    model.holding = true;
    model.stopped = '';
    member.place.add(this.ghostHand, this.thread, this.wall, this.label.sprite);
    const fields =
      target === 'tool'
        ? { target }
        : target === 'joint'
          ? { target, name: joint?.name }
          : { target, name: link, point: local.toArray() };
    void this.line.ask('grab', model.fields('grab', fields)).then((answer) => {
      if (answer.ok) held.granted = true;
      else if (this.held === held) this.drop(answer.code === 'held' ? `${answer.message}.` : answer.message);
    });
    this.onChange();
    return true;
  }

  /** Drag the held part: new position of the grabbed point, and rotation of the hand since the grab, in the scene. */
  move(point: Vector3, turn: Quaternion): void {
    const held = this.held;
    if (!held) return;
    const p = held.member.place.worldToLocal(point.clone());
    this.wanted = p.clone();
    if (held.target === 'tool') {
      const Q = held.member.place.getWorldQuaternion(new Quaternion());
      const R = Q.clone().invert().multiply(turn).multiply(Q);
      const at = held.tool.p.clone().sub(held.from).applyQuaternion(R).add(p);
      const q = R.multiply(held.tool.q).normalize();
      this.pending = { pose: seven(at, q) };
      this.wanted = at;
    } else if (held.target === 'joint') this.pending = { value: this.jointValueAt(held, p) };
    else this.pending = { point: p.toArray() };
    this.flush();
  }

  /** Set the target of a joint that is held by its slider. */
  moveJoint(value: number): void {
    this.wanted = null;
    this.pending = { value };
    this.flush();
  }

  end(): void {
    if (!this.held) return;
    this.flush(true);
    void this.line.ask('release', this.held.member.model.fields('release', {}));
    this.drop('');
  }

  /** End the grab, because the connection was lost or the server ended it. */
  drop(why: string): void {
    const member = this.held?.member;
    this.held = null;
    this.pending = this.wanted = null;
    if (member) {
      member.model.holding = false;
      member.robot?.mark('', 'none');
      if (why) member.model.say(why);
    }
    this.onChange();
  }

  /** Update handles, colours and the ghost of the hand from the newest state; send the waiting drag. */
  update(): void {
    this.flush();
    for (const member of this.members) this.draw(member);
  }

  private draw(member: Member): void {
    const { model, robot, handle } = member;
    const held = this.held?.member === member ? this.held : null;
    const pose = robot ? toolPose(model, robot) : null;
    if (!robot || !pose) return;
    handle.group.visible = model.page.line === 'open';
    const refused = held !== null && model.refused;
    // At a limit the wall shows which way is closed; the robot itself stays in its colours.
    const walled = refused && held?.target !== 'joint';
    if (held) robot.mark(held.link, refused && !walled ? 'refused' : 'held');
    handle.put(pose, 0.026 * member.size, refused ? RED : model.heldByOther ? 0x8a93a0 : BLUE);
    if (held || !this.held) this.drawGhostHand(refused, pose);
  }

  private drawGhostHand(refused: boolean, tool: Matrix4): void {
    const held = this.held;
    const on = refused && held !== null && this.wanted !== null;
    this.ghostHand.visible = this.thread.visible = this.wall.visible = on;
    this.label.sprite.visible = on;
    if (!on) return;
    const size = held.member.size;
    const wanted = this.wanted as Vector3;
    const node = held.member.robot?.links.get(held.link)?.node;
    const is =
      held.target === 'tool' || !node
        ? new Vector3().setFromMatrixPosition(tool)
        : held.local.clone().applyMatrix4(new Matrix4().compose(node.position, node.quaternion, ONE));
    this.ghostHand.position.copy(wanted);
    this.ghostHand.scale.setScalar(0.018 * size);
    const way = wanted.clone().sub(is);
    this.wall.visible = way.length() > WALL_GAP;
    this.wall.position.copy(is);
    this.wall.scale.setScalar(0.11 * size);
    if (this.wall.visible) this.wall.quaternion.setFromUnitVectors(AHEAD, way.normalize());
    const position = this.thread.geometry.getAttribute('position');
    position.setXYZ(0, is.x, is.y, is.z);
    position.setXYZ(1, wanted.x, wanted.y, wanted.z);
    position.needsUpdate = true;
    this.thread.computeLineDistances();
    this.label.sprite.position.copy(wanted).addScaledVector(UP, 0.03 * size);
    const away = held.target === 'joint' ? '' : `\n${length(wanted.distanceTo(is))} short`;
    this.label.say(`cannot follow${away}`, '#b3101e', this.world.look, 0.026 * size);
  }

  private flush(now = false): void {
    const time = performance.now();
    const held = this.held;
    if (!held || !this.pending || (!now && time - this.sentAt < INTERVAL)) return;
    if (!this.line.tell('drag', held.member.model.fields('drag', this.pending))) return;
    this.sentAt = time;
    held.sent = true;
    this.pending = null;
  }

  /** Return the joint value that brings the grabbed point nearest to p. */
  private jointValueAt(held: Held, p: Vector3): number {
    const { o, d } = held.axis;
    if (!held.joint || !isAngle(held.joint)) return held.value + p.clone().sub(held.from).dot(d);
    const a = held.from.clone().sub(o).projectOnPlane(d);
    const b = p.clone().sub(o).projectOnPlane(d);
    let angle = Math.atan2(a.clone().cross(b).dot(d), a.dot(b));
    angle += 2 * Math.PI * Math.round((held.last - angle) / (2 * Math.PI)); // continue over more than half a turn
    held.last = angle;
    return held.value + angle;
  }
}

/** Return the active joint that moves a link: its own, or the nearest one towards the base. */
function drivenBy(joints: readonly JointInfo[], link: string): JointInfo | undefined {
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

/** Return a point and the direction of a joint's axis in the robot's base frame. */
function axisOf(member: Member, joint: JointInfo | undefined): Held['axis'] {
  const o = new Vector3();
  const d = new Vector3(0, 0, 1);
  const node = joint ? member.robot?.links.get(joint.parent)?.node : undefined;
  if (joint && node) {
    o.fromArray(joint.axis.origin).applyQuaternion(node.quaternion).add(node.position);
    d.fromArray(joint.axis.direction).applyQuaternion(node.quaternion).normalize();
  }
  return { o, d };
}

const ONE = new Vector3(1, 1, 1);
const AHEAD = new Vector3(0, 0, 1);
const WALL_GAP = 5e-4; // m; a smaller distance between hand and tool has no visible direction
const UP = new Vector3(0, 0, 1);
