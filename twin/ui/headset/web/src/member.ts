/** A robot of the scene: its model, its drawing, and its place. */

import { Box3, Group, Vector3 } from 'three';
import { Handle } from './handle';
import type { RobotModel } from './model';
import { Overlays } from './overlays';
import { poseOf, type Robot } from './robot';
import type { World } from './world';

export class Member {
  robot: Robot | null = null;
  /** Node of the robot's base in the world; parent of all its displays. */
  readonly place = new Group();
  readonly overlays: Overlays;
  readonly handle = new Handle();

  constructor(
    world: World,
    readonly model: RobotModel,
  ) {
    this.overlays = new Overlays(world, this.place);
    this.place.add(this.handle.group);
    world.robotWorld.add(this.place);
  }

  /** Size of the robot's bounding box in m. */
  get size(): number {
    return this.overlays.size;
  }

  /** Add the loaded robot at its place, and adapt its displays to its size. */
  adopt(robot: Robot): void {
    const { model } = this;
    this.robot = robot;
    this.place.add(robot.root);
    robot.root.rotation.set(0, 0, 0); // `robotWorld` already rotates from z up to y up
    if (model.info) {
      const { p, q } = poseOf(model.info.T_world_base);
      this.place.position.copy(p);
      this.place.quaternion.copy(q);
      if (model.info.scenery) this.overlays.setScenery(model.info.scenery);
    }
    this.follow();
    const box = robot.box();
    if (model.info?.scenery) box.min.z = Math.min(box.min.z, model.info.scenery.floor);
    this.overlays.setSize(box.getSize(new Vector3()).length() / 1.5);
  }

  /** Set the link poses from the newest frame. */
  follow(): void {
    const { model, robot } = this;
    if (!robot || !model.frame || !model.info) return;
    robot.apply(model.frame, model.info.links);
    this.overlays.update(model, robot);
  }

  /** Bounding box in the world frame (z up), including the floor below the robot. */
  box(): Box3 {
    const box = this.robot?.box() ?? new Box3();
    const scenery = this.model.info?.scenery;
    if (scenery) box.min.z = Math.min(box.min.z, scenery.floor);
    this.place.updateMatrix();
    return box.applyMatrix4(this.place.matrix);
  }
}
