/** The robot's meshes. Link poses of the stream are applied without changes; the page has no kinematics. */

import {
  Box3,
  Color,
  EdgesGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Object3D,
  Quaternion,
  Vector3,
} from 'three';
import type { Frame } from './frame';
import { loadGlb } from './glb';
import type { RobotInfo } from './protocol';

const SAMPLES = 400; // vertices of a link for distances to a hand
const RED = 0xd81b2a;
const BLUE = 0x2d7fe0; // of a ghost
const GHOST = 0.32; // opacity of a ghost

interface Skin {
  mesh: Mesh;
  material: MeshStandardMaterial;
  color: Color;
  opacity: number;
}

export interface Link {
  name: string;
  node: Object3D;
  skins: Skin[];
  /** Some hundred vertices in the link's frame, for distances. */
  points: Vector3[];
}

/** Angle in deg between two triangles above which the edge between them is drawn. */
const CREASE = 35;

export type Mark = 'none' | 'hover' | 'held' | 'refused';

export class Robot {
  readonly links = new Map<string, Link>();
  /** Node that rotates from z up to y up. */
  readonly root: Object3D;
  private outline: LineSegments | null = null;
  private marked: [string, Mark] = ['', 'none'];
  private bright = false;
  private veiled = false;
  private readonly edges: LineSegments[] = [];
  private edged = false;

  private constructor(scene: Group) {
    this.root = scene.children.length === 1 && scene.children[0] ? scene.children[0] : scene;
  }

  /** Load the GLB and find its links. Throws an Error with the names of missing links. */
  static async load(about: RobotInfo): Promise<Robot> {
    const gltf = await loadGlb(`${about.files}robot.glb`);
    const robot = new Robot(gltf.scene);
    const nodes = new Map<string, Object3D>();
    gltf.scene.traverse((o) => {
      // the loader rewrites names with dots or blanks; the file's own is in userData
      const own: unknown = o.userData['link'] ?? o.userData['name'] ?? o.name;
      if (typeof own === 'string' && !nodes.has(own)) nodes.set(own, o);
    });
    const missing = about.links.filter((name) => !nodes.has(name));
    if (missing.length) throw new Error(`The robot's GLB file lacks the links ${missing.join(', ')}.`);
    for (const name of about.links) robot.links.set(name, dress(name, nodes.get(name) as Object3D));
    return robot;
  }

  /** Set the poses of all links from a frame. */
  apply(frame: Frame, names: readonly string[]): void {
    const v = frame.poses;
    names.forEach((name, i) => {
      const node = this.links.get(name)?.node;
      if (!node) return;
      node.position.fromArray(v, 7 * i);
      node.quaternion.fromArray(v, 7 * i + 3);
    });
    this.root.updateMatrixWorld(true);
  }

  /** Show all links except these. */
  hide(names: readonly string[]): void {
    for (const link of this.links.values()) link.node.visible = !names.includes(link.name);
  }

  /** Return the bounding box of all links in the root's frame (z up). */
  box(): Box3 {
    this.root.updateMatrixWorld(true);
    const inverse = new Matrix4().copy(this.root.matrixWorld).invert();
    const box = new Box3();
    for (const link of this.links.values())
      for (const p of link.points)
        box.expandByPoint(p.clone().applyMatrix4(link.node.matrixWorld).applyMatrix4(inverse));
    return box;
  }

  /** Meshes that a ray can hit. */
  targets(): Mesh[] {
    return [...this.links.values()].flatMap((l) => l.skins.map((s) => s.mesh));
  }

  /** Return the name of the link that an object belongs to. */
  linkOf(object: Object3D | null): string | null {
    for (let o = object; o; o = o.parent) {
      const name: unknown = o.userData['twinLink'];
      if (typeof name === 'string') return name;
    }
    return null;
  }

  /** Return the name of the link nearest to a point of the scene, and its distance in m in the scene. */
  nearest(point: Vector3): { link: string; distance: number } | null {
    let best: { link: string; distance: number } | null = null;
    const at = new Vector3();
    for (const link of this.links.values())
      for (const p of link.points) {
        const distance = at.copy(p).applyMatrix4(link.node.matrixWorld).distanceTo(point);
        if (!best || distance < best.distance) best = { link: link.name, distance };
      }
    return best;
  }

  /** Colour a link as hovered, held or refused; return false if its colour is unchanged. */
  mark(name: string, mark: Mark): boolean {
    if (this.marked[0] === name && this.marked[1] === mark) return false;
    this.marked = [name, mark];
    this.outline?.removeFromParent();
    this.outline = null;
    for (const link of this.links.values()) this.tint(link);
    const link = this.links.get(name);
    if (link && mark === 'refused') {
      this.outline = outlineOf(link);
      link.node.add(this.outline);
    }
    return true;
  }

  /** Brighten dark colours for additive displays, on which black is invisible. */
  brighten(on: boolean): void {
    this.bright = on;
    for (const link of this.links.values()) this.tint(link);
  }

  /** Show the whole robot as a ghost, or solid again. */
  veil(on: boolean): void {
    this.veiled = on;
    for (const lines of this.edges) lines.visible = this.edged && !on;
    for (const link of this.links.values()) {
      this.tint(link);
      for (const { mesh, material, opacity } of link.skins) {
        material.transparent = on || opacity < 1;
        material.depthWrite = !material.transparent;
        material.polygonOffset = on; // so that a solid robot at the same place hides the ghost
        material.polygonOffsetFactor = material.polygonOffsetUnits = 2;
        material.needsUpdate = true;
        mesh.castShadow = !material.transparent;
      }
    }
  }

  /** Draw the edges of all links (true) or none; they are computed when they are first drawn. */
  outlineAll(on: boolean): void {
    if (on && !this.edges.length)
      for (const { node, skins } of this.links.values()) {
        const solid = skins.filter(({ material }) => !material.transparent);
        if (!solid.length) continue;
        const lines = edgesOf(node, solid, new LineBasicMaterial({ color: 0x141a21, transparent: true, opacity: 0.42 }));
        this.edges.push(lines);
        node.add(lines);
      }
    this.edged = on;
    for (const lines of this.edges) lines.visible = on && !this.veiled;
  }

  /** Paint each link in a flat colour by its number from `first` on (for pixel tests), or restore it. */
  paint(on: boolean, first = 0): void {
    let i = first;
    for (const link of this.links.values()) {
      const flat = new MeshBasicMaterial({ color: paintOf(i++), toneMapped: false });
      for (const s of link.skins) s.mesh.material = on ? flat : s.material;
    }
  }

  /** Return a copy of a link's meshes in one translucent colour. */
  copyOf(name: string, color: number, opacity: number): Group {
    const group = new Group();
    const link = this.links.get(name);
    if (!link) return group;
    const material = new MeshStandardMaterial({ color, opacity, transparent: true, depthWrite: false });
    link.node.updateWorldMatrix(true, false);
    const inverse = new Matrix4().copy(link.node.matrixWorld).invert();
    for (const { mesh } of link.skins) {
      mesh.updateWorldMatrix(true, false);
      const twin = new Mesh(mesh.geometry, material);
      twin.applyMatrix4(new Matrix4().multiplyMatrices(inverse, mesh.matrixWorld));
      group.add(twin);
    }
    return group;
  }

  private tint(link: Link): void {
    const mark = this.marked[0] === link.name ? this.marked[1] : 'none';
    const glow = { none: 0x000000, hover: 0x1c4f8f, held: 0x1366d6, refused: RED }[mark];
    for (const { material, color, opacity } of link.skins) {
      material.color.copy(color);
      material.emissive.setHex(glow);
      material.emissiveIntensity = mark === 'hover' ? 0.35 : 0.5;
      if (this.bright) {
        // Additive displays add light: brighten dark colours, keep the hue, and avoid colours that are nearly black.
        const hsl = { h: 0, s: 0, l: 0 };
        color.getHSL(hsl);
        material.color.setHSL(hsl.h, hsl.s, 0.5 + 0.4 * hsl.l);
        if (mark === 'none') material.emissive.copy(material.color).multiplyScalar(0.18);
        material.emissiveIntensity = 1;
      }
      material.opacity = this.veiled ? GHOST : opacity;
      if (this.veiled) material.color.setHex(BLUE);
    }
  }
}

/** Return the colour of link number i in `paint`: 125 colours that differ by at least 60 in one channel. */
export function paintOf(i: number): Color {
  const k = (i * 37 + 7) % 125;
  const part = (n: number) => 15 + 60 * (n % 5);
  return new Color().setStyle(`rgb(${part(k)},${part(Math.floor(k / 5))},${part(Math.floor(k / 25))})`);
}

function dress(name: string, node: Object3D): Link {
  const skins: Skin[] = [];
  const points: Vector3[] = [];
  node.userData['twinLink'] = name;
  node.updateWorldMatrix(true, true);
  const inverse = new Matrix4().copy(node.matrixWorld).invert();
  node.traverse((o) => {
    if (!(o instanceof Mesh)) return;
    const mesh = o as Mesh;
    const old = mesh.material as MeshStandardMaterial;
    const material = old.clone(); // links may share a material, but are coloured separately
    material.userData = { ...material.userData, metalness: material.metalness };
    material.metalness = Math.min(material.metalness, 0.15); // without a room that it reflects, metal is black
    material.userData['dullness'] = material.metalness;
    material.roughness = Math.max(0.42, Math.min(material.roughness, 0.6));
    material.depthWrite = !material.transparent;
    mesh.material = material;
    mesh.castShadow = !material.transparent;
    mesh.receiveShadow = true;
    skins.push({ mesh, material, color: material.color.clone(), opacity: material.opacity });
    const T = new Matrix4().multiplyMatrices(inverse, mesh.matrixWorld);
    const position = mesh.geometry.getAttribute('position');
    const step = Math.max(1, Math.floor(position.count / SAMPLES));
    for (let i = 0; i < position.count; i += step)
      points.push(new Vector3().fromBufferAttribute(position, i).applyMatrix4(T));
  });
  return { name, node, skins, points };
}

/** Return the lines of the sharp edges of a link's meshes, in the frame of its node. */
function edgesOf(node: Object3D, skins: readonly Skin[], material: LineBasicMaterial): LineSegments {
  node.updateWorldMatrix(true, true);
  const inverse = new Matrix4().copy(node.matrixWorld).invert();
  const all: number[] = [];
  const p = new Vector3();
  for (const { mesh } of skins) {
    const T = new Matrix4().multiplyMatrices(inverse, mesh.matrixWorld);
    const edges = new EdgesGeometry(mesh.geometry, CREASE).getAttribute('position');
    for (let i = 0; i < edges.count; i++) all.push(...p.fromBufferAttribute(edges, i).applyMatrix4(T).toArray());
  }
  const lines = new LineSegments(undefined, material);
  lines.geometry.setAttribute('position', new Float32BufferAttribute(all, 3));
  return lines;
}

function outlineOf(link: Link): LineSegments {
  const material = new LineBasicMaterial({ color: RED, depthTest: false, toneMapped: false });
  const lines = edgesOf(link.node, link.skins, material);
  lines.renderOrder = 5;
  lines.userData['twinLink'] = link.name;
  return lines;
}

/** Return position and rotation of a pose of seven numbers. */
export function poseOf(v: ArrayLike<number>): { p: Vector3; q: Quaternion } {
  return {
    p: new Vector3(v[0], v[1], v[2]),
    q: new Quaternion(v[3], v[4], v[5], v[6]),
  };
}

export function matrixOf(v: ArrayLike<number>): Matrix4 {
  const { p, q } = poseOf(v);
  return new Matrix4().compose(p, q, new Vector3(1, 1, 1));
}
