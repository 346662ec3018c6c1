/** What a ray or a finger tip meets: the handle at the tool, a link, nothing. */

import { Matrix4, Raycaster, Vector3 } from 'three';
import type { Grab } from './grab';
import type { Robot } from './robot';

export interface Hit {
  /** The link, or null for the handle at the tool. */
  link: string | null;
  point: Vector3;
  distance: number;
}

const REACH = 0.035; // m in the room: a finger tip this near to a link takes it

/** First hit of a ray of the scene. The handle is met even where links hide it: it belongs to the hand. */
export function pickRay(caster: Raycaster, robot: Robot, grab: Grab): Hit | null {
  if (grab.handle.visible) {
    const hit = caster.intersectObject(grab.target, false)[0];
    if (hit) return { link: null, point: grab.handle.getWorldPosition(new Vector3()), distance: hit.distance };
  }
  const hit = caster.intersectObjects(robot.targets(), false)[0];
  const link = hit ? robot.linkOf(hit.object) : null;
  return hit && link !== null ? { link, point: hit.point, distance: hit.distance } : null;
}

/** What a finger tip at a point of the scene touches. */
export function pickNear(tip: Vector3, robot: Robot, grab: Grab): Hit | null {
  const handle = grab.handle.getWorldPosition(new Vector3());
  const radius = grab.handle.getWorldScale(new Vector3()).x;
  const far = handle.distanceTo(tip);
  if (grab.handle.visible && far < radius + REACH) return { link: null, point: tip.clone(), distance: far };
  const near = robot.nearest(tip);
  return near && near.distance < REACH ? { link: near.link, point: tip.clone(), distance: near.distance } : null;
}

export function rayOf(matrix: Matrix4, caster: Raycaster): Raycaster {
  caster.ray.origin.setFromMatrixPosition(matrix);
  caster.ray.direction.set(0, 0, -1).transformDirection(matrix);
  return caster;
}
