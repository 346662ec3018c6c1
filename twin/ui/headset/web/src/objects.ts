/** Movable objects of a task: the part of a frame after those of the robots has their poses in the world frame. */

import { Group, Mesh, type Object3D } from 'three';
import { type Frame, sameBytes } from './frame';
import { loadGlb } from './glb';
import { partsOf } from './overlays';
import type { ObjectsInfo } from './protocol';

export class Objects {
  /** Group below the world node (z up). */
  readonly group = new Group();
  /** Nodes in the order of the frame. */
  private nodes: (Object3D | undefined)[] = [];
  private shown: Uint8Array | undefined;

  /** Load the objects; return at once for a scene without objects. */
  async load(info: ObjectsInfo | undefined): Promise<void> {
    if (!info) return;
    const parts = partsOf((await loadGlb(info.file)).scene);
    this.nodes = info.names.map((name) => parts.find((part) => part.name === name));
    for (const node of this.nodes) {
      if (!node) continue;
      node.traverse((o) => {
        if (o instanceof Mesh) o.castShadow = o.receiveShadow = true;
      });
      this.group.add(node);
    }
  }

  /** Set the poses from a frame; return whether a new picture is needed. */
  update(frame: Frame | null): boolean {
    if (!frame || sameBytes(frame.body, this.shown)) return false;
    this.shown = frame.body;
    this.nodes.forEach((node, i) => {
      node?.position.fromArray(frame.poses, 7 * i);
      node?.quaternion.fromArray(frame.poses, 7 * i + 3);
    });
    return true;
  }

  /** Return the drawn position of an object in the world frame. For tests. */
  at(name: string): number[] {
    return this.nodes.find((node) => node?.name === name)?.position.toArray() ?? [];
  }
}
