/** The working ends of the instruments: a model of the tool that each carries, in its size, at the tip. */

import {
  BoxGeometry,
  type BufferGeometry,
  Color,
  CylinderGeometry,
  Group,
  Mesh,
  MeshStandardMaterial,
  Quaternion,
  Vector3,
} from 'three';
import type { App } from './app';
import type { Console } from './console';
import type { Member } from './member';
import { SIDES } from './pens';
import type { Side, ToolInfo } from './protocol';
import { poseOf } from './robot';

const THICK = 0.0032; // m: half the width of the holder, wider than the instruments' shafts
const AXES = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)].flatMap((axis) => [axis, axis.clone().negate()]);
const STEEL = 0xd5dbe2;
const HOT = 0xff5a1f;

interface Head {
  tool: string;
  robot: string;
  group: Group;
  /** The parts that open: +1 and -1 about the hinge. */
  jaws: [part: Group, sign: number][];
  material: MeshStandardMaterial;
}

export class Heads {
  private readonly shown: Partial<Record<Side, Head>> = {};

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {}

  /** Show the tools that the instruments carry; called with the other controls. */
  refresh(): void {
    for (const side of SIDES) {
      const hand = this.app.model.console?.hands[side];
      const name = hand?.carries ?? hand?.tool;
      const tool = this.console.info.tools.find((t) => t.name === name);
      const member = this.app.members.find((m) => m.model.info?.name === hand?.robot);
      if (!hand || !tool || !member?.robot) {
        this.remove(side);
        continue;
      }
      let head = this.shown[side];
      if (head?.tool !== tool.name || head.robot !== hand.robot) {
        this.remove(side);
        head = this.make(tool, hand.robot);
        if (!attach(head.group, member)) continue;
        this.shown[side] = head;
        this.app.world.touch();
      }
      const angle = hand.open ? Math.asin(Math.min(0.9, tool.open / 2 / tool.jaw)) : 0;
      for (const [part, sign] of head.jaws) {
        if (part.rotation.x !== sign * angle) this.app.world.touch();
        part.rotation.x = sign * angle;
      }
      const color = hand.active ? HOT : 0;
      if (head.material.emissive.getHex() !== color) {
        head.material.emissive = new Color(color);
        this.app.world.touch();
      }
    }
  }

  /** Return the name of the tool that is drawn at the instrument of a hand, and how far it is open in rad; for tests. */
  drawn(side: Side): { tool: string; angle: number } | null {
    const head = this.shown[side];
    return head ? { tool: head.tool, angle: Math.abs(head.jaws[0]?.[0].rotation.x ?? 0) } : null;
  }

  private remove(side: Side): void {
    const head = this.shown[side];
    if (!head) return;
    head.group.removeFromParent();
    head.group.traverse((o) => {
      if (o instanceof Mesh) (o.geometry as BufferGeometry).dispose();
    });
    head.material.dispose();
    delete this.shown[side];
    this.app.world.touch();
  }

  /** Make a model whose z axis points to the tip, which is the origin. */
  private make(tool: ToolInfo, robot: string): Head {
    const group = new Group();
    const material = new MeshStandardMaterial({ color: STEEL, metalness: 0.6, roughness: 0.35 });
    const { jaw } = tool;
    const part = (geometry: BufferGeometry, to: Group, x: number, y: number, z: number): void => {
      const mesh = new Mesh(geometry, material);
      mesh.position.set(x, y, z);
      to.add(mesh);
    };
    const holder = new CylinderGeometry(THICK, THICK, 0.006, 20).rotateX(Math.PI / 2);
    part(holder, group, 0, 0, -jaw - 0.003);
    const jaws: [Group, number][] = [];
    const hinged = (sign: number): Group => {
      const half = new Group();
      half.position.z = -jaw;
      group.add(half);
      jaws.push([half, -sign]);
      return half;
    };
    for (const sign of tool.kind === 'scalpel' || tool.kind === 'cautery' ? [] : [1, -1]) {
      const half = hinged(sign);
      const out = sign * 0.0012;
      if (tool.kind === 'scissors') {
        // a blade: a pointed, flat wedge
        part(new CylinderGeometry(0, 0.0024, jaw, 3).rotateX(Math.PI / 2).scale(0.3, 1, 1), half, sign * 0.0005, out, jaw / 2);
        continue;
      }
      const wide = tool.kind === 'clip_applier' ? 0.0052 : 0.0042;
      part(new BoxGeometry(wide, 0.0016, jaw), half, 0, out, jaw / 2);
      if (tool.kind === 'clip_applier') {
        part(new BoxGeometry(wide, 0.0034, 0.0016), half, 0, sign * 0.0019, jaw - 0.0008); // holds the end of a clip
        continue;
      }
      for (let tooth = 1; tooth < 6; tooth++) part(new BoxGeometry(wide, 0.0007, 0.0008), half, 0, sign * 0.0003, (tooth * jaw) / 6);
    }
    if (tool.kind === 'scalpel') {
      part(new CylinderGeometry(0, 0.0045, jaw, 3).rotateX(Math.PI / 2).scale(0.12, 1, 1), group, 0, 0.0012, -jaw / 2);
    }
    if (tool.kind === 'cautery') {
      part(new CylinderGeometry(0.0007, 0.0007, jaw, 12).rotateX(Math.PI / 2), group, 0, 0, -jaw / 2);
      part(new BoxGeometry(0.002, 0.0062, 0.002), group, 0, 0.0031, -0.001); // the hook
    }
    return { tool: tool.name, robot, group, jaws, material };
  }
}

/**
 * Attach a model to the tool of a robot, along the axis of the tool frame beyond which the link of the tool has nothing:
 * the tool frame is at the tip.
 */
function attach(group: Group, member: Member): boolean {
  const info = member.model.info;
  const link = info && member.robot?.links.get(info.tool.link);
  if (!info || !link) return false;
  const { p, q } = poseOf(info.tool.T_link_tool);
  let along = new Vector3();
  let least = Infinity;
  for (const axis of AXES) {
    const turned = axis.clone().applyQuaternion(q);
    const beyond = Math.max(...link.points.map((point) => point.clone().sub(p).dot(turned)));
    if (beyond < least) [least, along] = [beyond, turned];
  }
  group.position.copy(p);
  group.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), along));
  link.node.add(group);
  return true;
}
