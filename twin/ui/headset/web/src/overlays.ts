/** Displays around a robot: tool path, RCM and shaft, workspace, ghost of the equations, table and patient. */

import {
  BufferGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  InstancedMesh,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Object3D,
  Points,
  PointsMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { bytesOf } from './fields';
import { accent, flat, ORANGE, VIOLET } from './ink';
import { Label } from './label';
import { difference, length, type RobotModel } from './model';
import type { Numbers, Scenery, State } from './protocol';
import { matrixOf, poseOf, type Robot } from './robot';
import { discard, type World } from './world';

/** Magnifications of the distance between ghost and tool. */
const ENLARGEMENTS = [1, 10, 100, 1000, 10000, 100000];
const MISSED = 2e-3; // m
const SEEN = 0.03; // fraction of the robot's size: a clearly visible distance

export interface Shows {
  path: boolean;
  rcm: boolean;
  workspace: boolean;
  ghost: boolean;
  scenery: boolean;
  labels: boolean;
}

export class Overlays {
  readonly group = new Group();
  readonly shows: Shows = { path: true, rcm: true, workspace: false, ghost: true, scenery: false, labels: true };
  /** Text on the ghost; empty without a ghost. */
  ghostText = '';
  /** Number of received workspace points. */
  cloudCount = 0;
  cloudDone = false;

  private points: Numbers = [];
  private path: InstancedMesh | null = null;
  private readonly rcmBall: Mesh;
  private readonly shaft: Mesh;
  private readonly rcmLabel = new Label();
  /** Displays of all trocars after the first; they are created when needed and kept. */
  private readonly further: { ball: Mesh; label: Label }[] = [];
  private readonly ghostLabel = new Label();
  private ghost: Group | null = null;
  private readonly scenery = new Group();
  private around: Scenery | null = null;
  private lying = '';
  private cloud: Points | null = null;
  private cloudParts: { points: Float32Array; values: Float32Array | null }[] = [];

  /** Size of the robot's bounding box in m. */
  size = 1;
  /** Height of a line of text, in m. */
  line = 0.024;

  constructor(
    private readonly world: World,
    parent: Group,
  ) {
    this.rcmBall = new Mesh(new SphereGeometry(1, 20, 12), flat(ORANGE));
    this.shaft = new Mesh(new CylinderGeometry(1, 1, 1, 8), flat(ORANGE));
    this.rcmBall.visible = this.shaft.visible = false;
    this.group.add(this.rcmBall, this.shaft, this.rcmLabel.sprite, this.ghostLabel.sprite, this.scenery);
    parent.add(this.group);
  }

  /** Draw the path of the tool's tip: x y z of each point in m. */
  setPath(points: Numbers): void {
    this.points = points;
    if (this.path) discard(this.path);
    this.path = points.length >= 6 ? tube(points, 0.0016 * this.size) : null;
    if (this.path) this.group.add(this.path);
    this.world.touch();
  }

  /** Adapt the displays to the size of the robot, and the text to the size of the scene. */
  setSize(size: number, line = 0.024 * size): void {
    this.size = size;
    this.line = line;
    this.setPath(this.points);
    if (this.cloudCount) this.drawCloud();
  }

  setScenery(scenery: Scenery): void {
    this.around = scenery;
  }

  /** Return the assumptions on the shown patient, or the reason why there is no patient. */
  sceneryText(model: RobotModel): string {
    const name = model.protocol();
    if (!this.shows.scenery || !this.around || !name) return '';
    return this.around.patients[name]?.assumed ?? this.around.no_patient[name] ?? '';
  }

  /** Show patient and table of the protocol, and hide the links that they replace. */
  private standScenery(model: RobotModel, robot: Robot): void {
    const name = model.protocol();
    const patient = this.shows.scenery ? this.around?.patients[name] : undefined;
    robot.hide(patient?.replaces ?? []);
    this.scenery.visible = patient !== undefined;
    if (!patient || this.lying === name) return;
    this.lying = name;
    for (const thing of [...this.scenery.children]) discard(thing);
    void new GLTFLoader().loadAsync(`${model.info?.files ?? ''}patient/${name}.glb`).then(
      (gltf) => {
        if (this.lying !== name) return;
        this.scenery.add(...partsOf(gltf.scene));
        this.world.touch();
      },
      () => {
        this.lying = '';
        model.say(`The patient of ${name} could not be loaded.`);
      },
    );
  }

  /** Add workspace points: base64 of float32 x y z, and of a float32 value for each point. */
  addCloud(points: string, values: string | undefined, done: boolean): void {
    const part = floats(points);
    if (part.length) this.cloudParts.push({ points: part, values: values ? floats(values) : null });
    this.cloudCount += part.length / 3;
    this.cloudDone = done;
    this.drawCloud();
  }

  clearCloud(): void {
    this.cloudParts = [];
    this.cloudCount = 0;
    this.cloudDone = false;
    if (this.cloud) discard(this.cloud);
    this.cloud = null;
    this.world.touch();
  }

  /** Update all displays from the newest state. */
  update(model: RobotModel, robot: Robot): void {
    const s = this.shows;
    if (this.path) {
      this.path.visible = s.path;
      (this.path.material as MeshBasicMaterial).color.setHex(accent);
    }
    this.standScenery(model, robot);
    if (this.cloud) this.cloud.visible = s.workspace;
    const tool = toolPose(model, robot);
    this.drawRcm(model, tool);
    this.drawGhost(model, robot, tool);
  }

  private drawRcm(model: RobotModel, tool: Matrix4 | null): void {
    const at = model.state.rcm;
    const on = this.shows.rcm && at !== null && tool !== null;
    // A shaft that visibly misses the RCM is not drawn from the tool to the RCM.
    this.rcmBall.visible = on;
    this.shaft.visible = on && (model.state.rcm_error_m ?? 0) < MISSED;
    this.rcmLabel.sprite.visible = on && this.shows.labels;
    const trocars = model.state.trocars;
    this.drawFurther(on ? trocars.slice(1) : []);
    if (!on) return;
    const size = this.size;
    const rcm = new Vector3().fromArray(at);
    const tip = new Vector3().setFromMatrixPosition(tool);
    const along = rcm.clone().sub(tip);
    // The tool's origin may be the RCM itself (depth 0): then the shaft is its z axis.
    if (along.length() < 1e-3 * size) along.setFromMatrixColumn(tool, 2);
    along.normalize();
    const beyond = rcm.clone().addScaledVector(along, 0.12 * size);
    this.rcmBall.position.copy(rcm);
    this.rcmBall.scale.setScalar(0.009 * size);
    stretch(this.shaft, tip, beyond, 0.0018 * size);
    const several = trocars.length > 1;
    const port = model.info?.ports.find((p) => !several || p.trocar === trocars[0].name);
    // With several robots at one patient, only the label of the active robot has more than its name.
    const full = model === model.page.robot;
    this.rcmLabel.sprite.renderOrder = full ? 10 : 9;
    this.sayOf(
      this.rcmLabel,
      rcm,
      port ? `${model.info?.name}, port ${port.name}` : several ? trocars[0].name : 'RCM',
      full ? (several ? trocars[0].error_m : model.state.rcm_error_m) : null,
      full ? (several ? trocars[0].depth_m : model.state.depth_m) : null,
    );
  }

  private drawFurther(trocars: State['trocars']): void {
    while (this.further.length < trocars.length) {
      const ball = new Mesh(this.rcmBall.geometry, this.rcmBall.material);
      const label = new Label();
      this.group.add(ball, label.sprite);
      this.further.push({ ball, label });
    }
    this.further.forEach(({ ball, label }, i) => {
      const on = i < trocars.length;
      ball.visible = on;
      label.sprite.visible = on && this.shows.labels;
      if (!on) return;
      ball.position.fromArray(trocars[i].at);
      ball.scale.setScalar(0.009 * this.size);
      this.sayOf(label, ball.position, trocars[i].name, trocars[i].error_m, trocars[i].depth_m);
    });
  }

  private sayOf(label: Label, at: Vector3, name: string, error: number | null, depth: number | null): void {
    const size = this.size;
    const lines = [name];
    if (error !== null) lines.push(`distance of shaft ${difference(error)}`);
    if (depth !== null) lines.push(`depth ${length(depth)}`);
    label.sprite.position.copy(at).addScaledVector(new Vector3(0, 0, 1), 0.012 * size);
    label.say(lines.join('\n'), '#9a4f00', this.world.look, this.line);
  }

  private drawGhost(model: RobotModel, robot: Robot, tool: Matrix4 | null): void {
    const info = model.info;
    const seven = model.frame?.ghost;
    const on = this.shows.ghost && info !== null && tool !== null && !!seven;
    if (!on) {
      if (this.ghost) this.ghost.visible = false;
      this.ghostLabel.sprite.visible = false;
      this.ghostText = model.state.variant ? 'These equations give no tool pose at this state.' : '';
      return;
    }
    if (!this.ghost) {
      this.ghost = robot.copyOf(info.tool.link, VIOLET, 0.45);
      this.ghost.renderOrder = 2;
      this.group.add(this.ghost);
    }
    const by = poseOf(seven);
    const position = new Vector3();
    const turn = new Quaternion();
    tool.decompose(position, turn, new Vector3());
    const gap = by.p.clone().sub(position);
    const difference = by.q.clone().multiply(turn.clone().invert());
    if (difference.w < 0) difference.set(-difference.x, -difference.y, -difference.z, -difference.w);
    const sine = Math.hypot(difference.x, difference.y, difference.z);
    const angle = 2 * Math.atan2(sine, difference.w);
    const factor = enlargement(Math.max(gap.length() / this.size, angle / 6));
    const shown = position.clone().addScaledVector(gap, factor);
    const axis =
      sine > 1e-9 ? new Vector3(difference.x, difference.y, difference.z).divideScalar(sine) : gap.set(0, 0, 1);
    const enlarged = new Quaternion().setFromAxisAngle(axis, Math.min(angle * factor, 1)).multiply(turn);
    const T = new Matrix4().compose(shown, enlarged, new Vector3(1, 1, 1));
    T.multiply(matrixOf(info.tool.T_link_tool).invert());
    T.decompose(this.ghost.position, this.ghost.quaternion, this.ghost.scale);
    const far = by.p.distanceTo(position);
    const degrees = ((180 / Math.PI) * angle).toFixed(angle > 1e-3 ? 3 : 5);
    this.ghost.visible = far > 2e-8 || angle > 2e-7; // smaller differences are rounding errors of float32
    const times = factor > 1 ? `, magnified ×${factor.toLocaleString('en')}` : ', to scale';
    this.ghostText = this.ghost.visible
      ? `Equations ↔ mechanism: ${length(far)}, ${degrees}°${times}`
      : 'Equations and mechanism agree within the resolution of the stream (float32).';
    this.ghostLabel.sprite.visible = this.ghost.visible && this.shows.labels;
    this.ghostLabel.sprite.position.copy(shown).addScaledVector(new Vector3(0, 0, 1), 0.09 * this.size);
    this.ghostLabel.say(
      `equations: ${length(far)} from the tool\n${factor > 1 ? `magnified ×${factor.toLocaleString('en')}` : 'to scale'}`,
      '#6a25ad',
      this.world.look,
      this.line,
    );
  }

  private drawCloud(): void {
    if (this.cloud) discard(this.cloud);
    const n = this.cloudCount;
    const positions = new Float32Array(3 * n);
    const colors = new Float32Array(3 * n);
    let at = 0;
    const c = new Color();
    for (const part of this.cloudParts) {
      positions.set(part.points, 3 * at);
      for (let i = 0; i < part.points.length / 3; i++) {
        // Condition number: 1 is best; blue is well conditioned, red is badly conditioned.
        const value = part.values?.[i] ?? 1;
        c.setHSL(0.6 * (1 - Math.min(1, Math.log10(Math.max(1, value)) / 2.5)), 0.75, 0.5);
        c.toArray(colors, 3 * (at + i));
      }
      at += part.points.length / 3;
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(positions, 3));
    geometry.setAttribute('color', new Float32BufferAttribute(colors, 3));
    const material = new PointsMaterial({
      vertexColors: true,
      size: 0.018 * this.size,
      transparent: true,
      opacity: 0.75,
      depthWrite: false,
    });
    this.cloud = new Points(geometry, material);
    this.cloud.visible = this.shows.workspace;
    this.group.add(this.cloud);
    this.world.touch();
  }
}

/** Return the tool pose in the robot's base frame from the newest link poses; null before the first frame. */
export function toolPose(model: RobotModel, robot: Robot): Matrix4 | null {
  const info = model.info;
  const node = info ? robot.links.get(info.tool.link)?.node : undefined;
  if (!info || !node) return null;
  const T = new Matrix4().compose(node.position, node.quaternion, new Vector3(1, 1, 1));
  return T.multiply(matrixOf(info.tool.T_link_tool));
}

/** Return the smallest power of ten that makes a distance (fraction of the robot's size) clearly visible. */
export function enlargement(part: number): number {
  return ENLARGEMENTS.find((f) => part * f >= SEEN / 3) ?? (ENLARGEMENTS.at(-1) as number);
}

/** Stretch a cylinder of height 1 along y from a to b. */
export function stretch(mesh: Object3D, a: Vector3, b: Vector3, radius: number): void {
  const along = b.clone().sub(a);
  const long = Math.max(along.length(), 1e-9);
  mesh.position.copy(a).addScaledVector(along, 0.5);
  mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), along.divideScalar(long));
  mesh.scale.set(radius, long, radius);
}

/** Return a path through points as a chain of cylinders. */
export function tube(points: Numbers, radius: number): InstancedMesh {
  const n = points.length / 3 - 1;
  const mesh = new InstancedMesh(new CylinderGeometry(1, 1, 1, 6, 1, true), flat(accent), n);
  const piece = new Object3D();
  const [a, b] = [new Vector3(), new Vector3()];
  for (let i = 0; i < n; i++) {
    stretch(piece, a.fromArray(points as number[], 3 * i), b.fromArray(points as number[], 3 * i + 3), radius);
    piece.updateMatrix();
    mesh.setMatrixAt(i, piece.matrix);
  }
  mesh.frustumCulled = false;
  return mesh;
}

/** Return the parts of a patient in the robot's base frame (z up). */
export function partsOf(scene: Group): Object3D[] {
  const root = scene.children.length === 1 && scene.children[0] ? scene.children[0] : scene;
  const parts = [...root.children].filter((o) => !o.name.startsWith('frame_'));
  for (const part of parts) {
    const own: unknown = part.userData['link']; // the loader renames parts with the root's name
    if (typeof own === 'string') part.name = own;
    part.traverse((o) => {
      if (!(o instanceof Mesh)) return;
      const skin = o.material as MeshStandardMaterial;
      if (skin.transparent) {
        skin.side = DoubleSide;
        skin.depthWrite = false;
      }
      o.receiveShadow = o.castShadow = !skin.transparent;
    });
  }
  return parts;
}

function floats(base64: string): Float32Array {
  return new Float32Array(bytesOf(base64).buffer);
}
