/** Find the handle or link that a ray hits or a fingertip touches. */

import { Matrix4, Raycaster, Vector3 } from 'three';
import type { Member } from './member';

export interface Hit {
  /** Robot of the hit part. */
  member: Member;
  /** Name of the link; null for the handle at the tool. */
  link: string | null;
  point: Vector3;
  distance: number;
}

const REACH = 0.035; // m in the room: distance at which a fingertip touches a link

/** Return the first hit of a ray in the scene; a handle is hit even behind links. */
export function pickRay(caster: Raycaster, members: readonly Member[]): Hit | null {
  return nearest(members, (m) => ballHit(caster, m)) ?? nearest(members, (m) => linkHit(caster, m));
}

/** Return the part that a fingertip at a point of the scene touches. */
export function pickNear(tip: Vector3, members: readonly Member[]): Hit | null {
  return nearest(members, (m) => ballNear(tip, m)) ?? nearest(members, (m) => linkNear(tip, m));
}

function nearest(members: readonly Member[], hitOf: (member: Member) => Hit | null): Hit | null {
  let best: Hit | null = null;
  for (const member of members) {
    const hit = member.robot ? hitOf(member) : null;
    if (hit && (!best || hit.distance < best.distance)) best = hit;
  }
  return best;
}

function ballHit(caster: Raycaster, member: Member): Hit | null {
  const { group, ball } = member.handle;
  const hit = group.visible ? caster.intersectObject(ball, false)[0] : undefined;
  return hit ? { member, link: null, point: group.getWorldPosition(new Vector3()), distance: hit.distance } : null;
}

function linkHit(caster: Raycaster, member: Member): Hit | null {
  const hit = caster.intersectObjects(member.robot?.targets() ?? [], false)[0];
  const link = hit ? (member.robot?.linkOf(hit.object) ?? null) : null;
  return hit && link !== null ? { member, link, point: hit.point, distance: hit.distance } : null;
}

function ballNear(tip: Vector3, member: Member): Hit | null {
  const { group } = member.handle;
  const distance = group.getWorldPosition(new Vector3()).distanceTo(tip);
  const radius = group.getWorldScale(new Vector3()).x;
  return group.visible && distance < radius + REACH ? { member, link: null, point: tip.clone(), distance } : null;
}

function linkNear(tip: Vector3, member: Member): Hit | null {
  const near = member.robot?.nearest(tip);
  return near && near.distance < REACH ? { member, link: near.link, point: tip.clone(), distance: near.distance } : null;
}

export function rayOf(matrix: Matrix4, caster: Raycaster): Raycaster {
  caster.ray.origin.setFromMatrixPosition(matrix);
  caster.ray.direction.set(0, 0, -1).transformDirection(matrix);
  return caster;
}
