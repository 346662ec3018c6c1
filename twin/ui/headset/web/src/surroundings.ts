/** Surroundings of a scene: furniture and patient, ports, cameras and their fields of view. */

import {
  Box3,
  BufferGeometry,
  Color,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  type Object3D,
  TorusGeometry,
} from 'three';
import { loadGlb } from './glb';
import { Label } from './label';
import type { Member } from './member';
import { accentuate, flat, ORANGE } from './ink';
import { partsOf } from './overlays';
import type { CameraInfo, SceneInfo } from './protocol';
import { poseOf } from './robot';
import { layTissue, tissueTexture } from './tissue';
import type { World } from './world';

const THROUGH = 0.25; // opacity of transparent surroundings
const SIGHT = 0.12; // length in m of the pyramid of a camera's field of view

export class Surroundings {
  /** Group below the world node (z up). */
  readonly props = new Group();
  seeThrough = false;
  marks = true;
  private readonly rings: Mesh[] = [];
  private readonly eyes: Group[] = [];
  private readonly labels: Label[] = [];
  /** Original opacity of each part. */
  private readonly opacities = new Map<Mesh<BufferGeometry, MeshStandardMaterial>, number>();

  constructor(private readonly world: World) {
    world.robotWorld.add(this.props);
  }

  /** Load the props; return at once for a scene without props. */
  async load(scene: SceneInfo): Promise<void> {
    if (!scene.props) return;
    const gltf = await loadGlb(scene.props.file);
    this.props.add(...partsOf(gltf.scene));
    this.props.traverse((o) => {
      if (!(o instanceof Mesh)) return;
      const mesh = o as Mesh<BufferGeometry, MeshStandardMaterial>;
      mesh.material = mesh.material.clone(); // parts may share a material
      this.opacities.set(mesh, mesh.material.opacity);
    });
  }

  /** Add rings at the ports and pyramids at the cameras, after the robots are loaded. */
  mark(scene: SceneInfo, members: readonly Member[]): void {
    for (const member of members)
      for (const port of member.model.info?.ports ?? []) {
        const ring = new Mesh(new TorusGeometry(1, 0.12, 10, 40), flat(ORANGE));
        ring.position.fromArray(port.at as number[]);
        ring.scale.setScalar(0.014 * this.world.size);
        member.place.add(ring);
        this.rings.push(ring);
      }
    for (const camera of scene.cameras) {
      const robot = members.find((m) => m.model.info?.name === camera.robot)?.robot;
      const node = robot?.links.get(camera.link)?.node;
      if (node) node.add(this.eye(camera));
    }
  }

  private eye(camera: CameraInfo): Group {
    const eye = new Group();
    const { p, q } = poseOf(camera.T_link_camera);
    eye.position.copy(p);
    eye.quaternion.copy(q);
    const half = SIGHT * Math.tan(camera.view / 2);
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => [half * (x ?? 0), half * (y ?? 0), SIGHT]);
    const points = corners.flatMap((c, i) => [0, 0, 0, ...c, ...c, ...(corners[(i + 1) % 4] as number[])]);
    const geometry = new BufferGeometry().setAttribute('position', new Float32BufferAttribute(points, 3));
    eye.add(new LineSegments(geometry, accentuate(new LineBasicMaterial({ toneMapped: false }))));
    const label = new Label();
    label.sprite.position.set(0, 0, SIGHT);
    label.say(camera.name, '#12438a', 'normal', 0.013 * this.world.size);
    eye.add(label.sprite);
    this.labels.push(label);
    this.eyes.push(eye);
    return eye;
  }

  /** Return the meshes of the props; they never move. */
  get parts(): readonly Mesh[] {
    return [...this.opacities.keys()];
  }

  /** Return the markers of ports and cameras. */
  get signs(): readonly Object3D[] {
    return [...this.rings, ...this.eyes];
  }

  show(props: boolean, labels: boolean): void {
    this.props.visible = props;
    for (const thing of [...this.rings, ...this.eyes]) thing.visible = this.marks;
    for (const label of this.labels) label.sprite.visible = labels && this.marks;
    for (const [mesh, opacity] of this.opacities) {
      const { material } = mesh;
      material.opacity = this.seeThrough ? Math.min(opacity, THROUGH) : opacity;
      const transparent = material.opacity < 1;
      if (material.transparent !== transparent) material.needsUpdate = true;
      material.transparent = transparent;
      material.depthWrite = mesh.castShadow = !transparent;
    }
    this.world.touch();
  }

  /** Brighten dark colours for additive displays, on which black is invisible. */
  brighten(on: boolean): void {
    for (const { material } of this.opacities.keys())
      material.emissive = on ? material.color.clone().multiplyScalar(0.18) : new Color(0);
    this.world.touch();
  }

  /** Give a body of the props another colour (linear), and the pattern of tissue if wanted. */
  finish(body: string, color: readonly number[], tissue: boolean): void {
    const part = this.props.children.find((o) => o.name === body);
    const [r, g, b] = color;
    part?.traverse((o) => {
      if (!(o instanceof Mesh)) return;
      const mesh = o as Mesh<BufferGeometry, MeshStandardMaterial>;
      mesh.material.color.setRGB(r ?? 1, g ?? 1, b ?? 1);
      if (!tissue) return;
      layTissue(mesh.geometry);
      mesh.material.map = tissueTexture();
      mesh.material.roughness = 0.5;
      mesh.material.needsUpdate = true;
    });
    this.world.touch();
  }

  /** Bounding box in the world frame (z up). */
  box(): Box3 {
    const box = new Box3();
    if (!this.props.children.length) return box;
    this.world.robotWorld.updateMatrixWorld(true);
    box.setFromObject(this.props);
    return box.applyMatrix4(this.world.robotWorld.matrixWorld.clone().invert());
  }
}
