/** Place and displayed size of the robot in the room. */

import { Group, Matrix4, Mesh, Quaternion, RingGeometry, Vector3 } from 'three';
import { accentuate, BLUE, flat } from './ink';
import { VIEW, type World } from './world';

export const SMALLEST = 0.1;
export const LARGEST = 10;

export class Place {
  /** Whether the next select event places the robot at the reticle. */
  placing = false;
  /** Whether a pinch moves the whole robot. */
  moving = false;
  /** Reticle: a ring on the floor at the possible place of the robot. */
  readonly reticle = new Group();
  onChange: () => void = () => undefined;

  /** Height in m of the floor below the robot, in the scene. */
  private ground = 0;
  private two: { mid: Vector3; apart: number; angle: number; scale: number; yaw: number; position: Vector3 } | null =
    null;

  constructor(private readonly world: World) {
    const ring = new Mesh(new RingGeometry(0.085, 0.1, 48).rotateX(-Math.PI / 2), accentuate(flat(BLUE)));
    const dot = new Mesh(new RingGeometry(0, 0.012, 24).rotateX(-Math.PI / 2), accentuate(flat(BLUE)));
    this.reticle.add(ring, dot);
    this.reticle.visible = false;
    this.reticle.matrixAutoUpdate = false;
    world.scene.add(this.reticle);
  }

  private get node(): Group {
    return this.world.placement;
  }

  get scale(): number {
    return this.node.scale.x;
  }

  get yaw(): number {
    return this.node.rotation.y;
  }

  get height(): number {
    return this.node.position.y - this.ground;
  }

  setScale(scale: number): void {
    this.node.scale.setScalar(Math.min(LARGEST, Math.max(SMALLEST, scale)));
    this.changed();
  }

  setYaw(yaw: number): void {
    this.node.rotation.set(0, Math.atan2(Math.sin(yaw), Math.cos(yaw)), 0);
    this.changed();
  }

  setHeight(height: number): void {
    this.node.position.y = this.ground + height;
    this.changed();
  }

  /** Reset the place on a screen: on the floor, to scale. In XR, use `before`. */
  reset(): void {
    this.node.scale.setScalar(1);
    this.node.rotation.set(0, 0, 0);
    if (!this.world.renderer.xr.isPresenting) {
      this.ground = 0;
      this.node.position.set(0, 0, 0);
    }
    this.changed();
  }

  /** Place the robot on the floor at a point, with its front towards the viewer. */
  putAt(point: Vector3, viewer: Vector3): void {
    this.ground = point.y;
    this.node.position.copy(point);
    this.face(viewer);
    this.placing = false;
    this.reticle.visible = false;
    this.changed();
  }

  /** Place the robot in front of the viewer: on the floor, or at table height if it is small. */
  before(viewer: Vector3, forward: Vector3, floor: number): void {
    const ahead = forward.clone().setY(0);
    if (ahead.lengthSq() < 1e-6) ahead.set(0, 0, -1);
    const s = this.world.size * this.scale;
    this.ground = floor;
    this.node.position
      .copy(viewer)
      .addScaledVector(ahead.normalize(), Math.max(0.6, 0.75 + 0.7 * s))
      .setY(floor);
    // Small robots are at table height, large robots on the floor.
    if (s < 1) this.node.position.y = floor + Math.max(0, Math.min(0.75, viewer.y - floor - 0.35 - 0.6 * s));
    this.face(viewer);
    this.changed();
  }

  begin(): void {
    this.placing = true;
    this.changed();
  }

  /** Show the reticle at the pose of a hit test; null without a hit. */
  aim(matrix: Matrix4 | null): void {
    this.reticle.visible = this.placing && matrix !== null;
    if (matrix) this.reticle.matrix.copy(matrix);
    this.reticle.matrixWorldNeedsUpdate = true;
  }

  /** Start a motion by two hands: the robot follows their midpoint, distance and direction. */
  beginTwo(a: Vector3, b: Vector3): void {
    this.two = {
      mid: a.clone().add(b).multiplyScalar(0.5),
      apart: Math.max(0.02, a.distanceTo(b)),
      angle: Math.atan2(b.x - a.x, b.z - a.z),
      scale: this.scale,
      yaw: this.yaw,
      position: this.node.position.clone(),
    };
  }

  moveTwo(a: Vector3, b: Vector3): void {
    const t = this.two;
    if (!t) return;
    const scale = Math.min(LARGEST, Math.max(SMALLEST, (t.scale * a.distanceTo(b)) / t.apart));
    const turn = Math.atan2(b.x - a.x, b.z - a.z) - t.angle;
    const mid = a.clone().add(b).multiplyScalar(0.5);
    const arm = t.position
      .clone()
      .sub(t.mid)
      .multiplyScalar(scale / t.scale);
    arm.applyQuaternion(new Quaternion().setFromAxisAngle(UP, turn));
    this.node.position.copy(mid).add(arm);
    this.node.scale.setScalar(scale);
    this.setYaw(t.yaw + turn);
  }

  endTwo(): void {
    this.two = null;
  }

  /** Move the robot by the displacement of one hand. */
  shift(by: Vector3): void {
    this.node.position.add(by);
    this.changed();
  }

  private face(viewer: Vector3): void {
    const d = viewer.clone().sub(this.node.position);
    this.node.rotation.set(0, Math.atan2(d.x, d.z) - Math.atan2(VIEW.x, VIEW.z), 0);
  }

  private changed(): void {
    this.node.updateMatrixWorld(true);
    this.world.relight();
    this.onChange();
  }
}

const UP = new Vector3(0, 1, 0);
