/** What is drawn and not measured: belts, motors, cables, drapes, a tissue bed; and a person, to compare sizes with. */

import {
  Box3,
  BufferGeometry,
  Color,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  type Object3D,
  Vector3,
} from 'three';
import { mergeGeometries } from 'three/addons/utils/BufferGeometryUtils.js';
import { loadGlb } from './glb';
import type { Member } from './member';
import { partsOf } from './overlays';
import type { CableInfo, DrawnInfo, SceneInfo } from './protocol';
import type { Surroundings } from './surroundings';
import { layTissue, tissueTexture } from './tissue';
import type { World } from './world';

const COUNT = 17; // points along a cable
const AROUND = 7; // facets around it
const BESIDE = 0.5; // m between the robots and the person
const LEFT: Readonly<Vector3> = new Vector3(-0.79, -0.61, 0); // in the first view, in the world frame (z up)

/** A cable, whose shape follows the bodies at its ends. */
interface Cable {
  info: CableInfo;
  member: Member;
  nodes: readonly [Object3D, Object3D];
  mesh: Mesh;
  /** Ends when it was last drawn, in the frame of the robot's base. */
  drawn: [Vector3, Vector3];
}

export class Drawn {
  on = true;
  /** Whether the person is shown. */
  personal = false;
  readonly person = new Group();
  private readonly parts: Mesh[] = [];
  /** Those of the parts that no robot carries. */
  private readonly fixed: Mesh[] = [];
  private readonly cables: Cable[] = [];
  private info: DrawnInfo | null = null;
  private figure: Promise<void> | null = null;

  constructor(private readonly world: World) {
    this.person.visible = false;
    world.robotWorld.add(this.person);
  }

  /** The notes on what is drawn; empty if nothing is. */
  get notes(): string {
    return this.info && this.on ? this.info.notes.join('\n') : '';
  }

  /** Whether this robot or scene has drawn parts. */
  get any(): boolean {
    return this.info !== null;
  }

  /** Load the parts and add them to the bodies that carry them; later than the first picture, for which nobody waits. */
  async load(scene: SceneInfo, members: readonly Member[], surroundings: Surroundings): Promise<void> {
    const info = scene.drawn;
    if (!info) return;
    for (const { body, color, pattern } of info.finishes) surroundings.finish(body, color, pattern === 'tissue');
    if (info.file) {
      const found = partsOf((await loadGlb(info.file)).scene);
      for (const { node, robot, link, pattern } of info.parts) {
        const body = found.find((o) => o.name === node);
        const carrier = robot === null ? this.world.robotWorld : nodeOf(members, robot, link);
        if (!body || !carrier) continue;
        const part = joined(body, pattern === 'tissue');
        // belts and motors lie close to links, which cast shadows themselves
        if (robot !== null) part.castShadow = false;
        carrier.add(part);
        (robot === null ? this.fixed : this.parts).push(part);
      }
    }
    for (const cable of info.cables) this.hang(cable, members);
    this.info = info;
    this.update();
  }

  /** Show or hide the drawn parts; those that no robot carries are also hidden with the surroundings. */
  show(on: boolean, around: boolean): void {
    this.on = on;
    for (const part of this.parts) part.visible = on;
    for (const part of this.fixed) part.visible = on && around;
    for (const { mesh } of this.cables) mesh.visible = on;
    this.update();
    this.world.touch();
  }

  /** Return the meshes that never move. */
  get still(): readonly Mesh[] {
    return this.fixed;
  }

  /** Let the cables follow the robots. */
  update(): void {
    if (!this.on) return;
    for (const cable of this.cables) follow(cable);
  }

  /** Show or hide the person beside the robots, whose bounding box in the world frame is `box`. */
  async stand(info: SceneInfo['person'], on: boolean, box: Box3): Promise<void> {
    this.personal = on;
    if (on && info) {
      this.figure ??= this.fetch(info.file);
      await this.figure;
    }
    const middle = box.getCenter(new Vector3());
    const size = box.getSize(new Vector3());
    this.person.position.copy(middle).addScaledVector(LEFT, 0.5 * Math.hypot(size.x, size.y) + BESIDE);
    this.person.position.z = box.min.z;
    this.person.rotation.z = Math.atan2(-LEFT.y, -LEFT.x); // looks at the robots
    this.person.visible = this.personal;
    this.world.touch();
  }

  /** Bounding box of the person in the world frame; empty if nobody stands there. */
  box(): Box3 {
    const box = new Box3();
    if (!this.person.visible) return box;
    this.world.robotWorld.updateMatrixWorld(true);
    return box.setFromObject(this.person).applyMatrix4(this.world.robotWorld.matrixWorld.clone().invert());
  }

  private async fetch(file: string): Promise<void> {
    for (const body of partsOf((await loadGlb(file)).scene)) this.person.add(joined(body, false));
  }

  private hang(info: CableInfo, members: readonly Member[]): void {
    const member = members.find((m) => m.model.info?.name === info.robot);
    const [a, b] = info.ends.map(({ link }) => nodeOf(members, info.robot, link));
    if (!member || !a || !b) return;
    const [red, green, blue] = info.color;
    const color = new Color().setRGB(red ?? 0, green ?? 0, blue ?? 0);
    const mesh = new Mesh(tube(), new MeshStandardMaterial({ color, roughness: 0.7, metalness: 0 }));
    mesh.frustumCulled = false; // its shape changes
    member.place.add(mesh);
    const nowhere = (): Vector3 => new Vector3(Infinity, 0, 0);
    this.cables.push({ info, member, nodes: [a, b], mesh, drawn: [nowhere(), nowhere()] });
  }
}

function nodeOf(members: readonly Member[], robot: string | null, link: string | null): Object3D | undefined {
  const member = members.find((m) => m.model.info?.name === robot);
  return link === null ? undefined : member?.robot?.links.get(link)?.node;
}

/** Return one mesh of all meshes of a body, whose vertices have their colours and opacities: one call draws it. */
function joined(body: Object3D, tissue: boolean): Mesh<BufferGeometry, MeshStandardMaterial> {
  body.updateMatrixWorld(true);
  const inverse = new Matrix4().copy(body.matrixWorld).invert();
  const geometries: BufferGeometry[] = [];
  let transparent = false;
  body.traverse((o) => {
    if (!(o instanceof Mesh)) return;
    const { geometry: own, material, matrixWorld } = o as Mesh<BufferGeometry, MeshStandardMaterial>;
    const geometry = new BufferGeometry();
    geometry.setIndex(own.index);
    geometry.setAttribute('position', own.getAttribute('position').clone());
    geometry.setAttribute('normal', own.getAttribute('normal').clone());
    geometry.setAttribute('color', colored(material, own.getAttribute('position').count));
    transparent ||= material.opacity < 1;
    geometries.push(geometry.applyMatrix4(new Matrix4().multiplyMatrices(inverse, matrixWorld)));
  });
  const geometry = mergeGeometries(geometries);
  if (tissue) layTissue(geometry);
  const material = new MeshStandardMaterial({
    vertexColors: true,
    transparent,
    depthWrite: !transparent,
    forceSinglePass: true,
    map: tissue ? tissueTexture() : null,
    roughness: tissue ? 0.5 : 0.6,
    metalness: 0, // metal is black where it reflects no room
    side: DoubleSide, // a cloth is open below
  });
  const mesh = new Mesh(geometry, material);
  mesh.name = body.name;
  body.matrix.decompose(mesh.position, mesh.quaternion, mesh.scale);
  mesh.castShadow = !transparent;
  mesh.receiveShadow = true;
  return mesh;
}

function colored({ color, opacity }: MeshStandardMaterial, count: number): Float32BufferAttribute {
  const all = new Float32Array(4 * count);
  for (let i = 0; i < count; i++) all.set([color.r, color.g, color.b, opacity], 4 * i);
  return new Float32BufferAttribute(all, 4);
}

/** Draw a cable anew if its ends have moved; the frame of its mesh is that of the robot's base. */
function follow(cable: Cable): void {
  const { info, member, nodes, mesh, drawn } = cable;
  const [a, b] = nodes.map((node, i) => {
    const end = new Vector3().fromArray((info.ends[i] as CableInfo['ends'][0]).at as number[]);
    // the pose of a link is that in the frame of the base
    node.updateMatrix();
    return end.applyMatrix4(node.matrix);
  }) as [Vector3, Vector3];
  if (a.distanceTo(drawn[0]) < 1e-6 && b.distanceTo(drawn[1]) < 1e-6) return;
  cable.drawn = [a, b];
  bend(mesh.geometry, hanging(a, b, info.length), info.radius);
  mesh.visible = member.robot !== null;
}

/** Return the points of a cable of a length in m that hangs between two points, as twin/ui/session/drawn_parts.py. */
export function hanging(a: Vector3, b: Vector3, length: number): Vector3[] {
  const chord = a.distanceTo(b);
  const slack = length - chord;
  const sag = slack > 0 ? Math.min(Math.sqrt((3 / 8) * chord * slack) + 0.25 * slack, 0.5 * length) : 0;
  return Array.from({ length: COUNT }, (_, k) => {
    const t = k / (COUNT - 1);
    const p = a.clone().lerp(b, t);
    p.z -= 4 * t * (1 - t) * sag;
    return p;
  });
}

function tube(): BufferGeometry {
  const geometry = new BufferGeometry();
  const index: number[] = [];
  for (let k = 0; k + 1 < COUNT; k++)
    for (let i = 0; i < AROUND; i++) {
      const [a, b] = [k * AROUND + i, k * AROUND + ((i + 1) % AROUND)];
      index.push(a, b, b + AROUND, a, b + AROUND, a + AROUND);
    }
  geometry.setIndex(index);
  geometry.setAttribute('position', new Float32BufferAttribute(3 * COUNT * AROUND, 3));
  geometry.setAttribute('normal', new Float32BufferAttribute(3 * COUNT * AROUND, 3));
  return geometry;
}

/** Lay a tube around points. */
function bend(geometry: BufferGeometry, points: readonly Vector3[], radius: number): void {
  const position = geometry.getAttribute('position');
  const normal = geometry.getAttribute('normal');
  const [axis, side, other, n] = [new Vector3(), new Vector3(), new Vector3(), new Vector3()];
  points.forEach((p, k) => {
    const before = points[Math.max(0, k - 1)] as Vector3;
    const after = points[Math.min(points.length - 1, k + 1)] as Vector3;
    axis.subVectors(after, before).normalize();
    // a cable hangs in an upright plane, across which one direction stays; one that hangs straight down has any
    if (k === 0) {
      side.set(-axis.y, axis.x, 0);
      if (side.lengthSq() < 1e-8) side.set(1, 0, 0);
    }
    side.addScaledVector(axis, -side.dot(axis)).normalize();
    other.crossVectors(axis, side);
    for (let i = 0; i < AROUND; i++) {
      const angle = (2 * Math.PI * i) / AROUND;
      n.copy(side).multiplyScalar(Math.cos(angle)).addScaledVector(other, Math.sin(angle));
      normal.setXYZ(k * AROUND + i, n.x, n.y, n.z);
      position.setXYZ(k * AROUND + i, p.x + radius * n.x, p.y + radius * n.y, p.z + radius * n.z);
    }
  });
  position.needsUpdate = normal.needsUpdate = true;
}
