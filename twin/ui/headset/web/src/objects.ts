/** Movable objects of a task: the part of a frame after those of the robots has their poses in the world frame. */

import { Group, Mesh, type Object3D } from 'three';
import { type Frame, sameBytes } from './frame';
import { loadGlb } from './glb';
import { Label } from './label';
import { partsOf } from './overlays';
import type { ObjectsInfo } from './protocol';
import { SCOPE_LIGHT } from './views';

const TALL = 0.004; // m: height of the number of an object
const BELOW = 2.5; // distance from the bottom of the number to the middle of its object, in heights of the number

export class Objects {
  /** Group below the world node (z up). */
  readonly group = new Group();
  /** Nodes in the order of the frame. */
  private nodes: (Object3D | undefined)[] = [];
  private readonly labels = new Map<Object3D, Label>();
  private labelled = true;
  /** Objects with a number, also those that are not loaded yet. */
  private numbered: readonly string[] = [];
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
    this.number(this.numbered);
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

  /** Show or hide the numbers. */
  show(labels: boolean): void {
    this.labelled = labels;
    for (const { sprite } of this.labels.values()) sprite.visible = labels;
  }

  /** Show the numbers of objects such as "ring1" below them in the endoscope's picture, as the scoreboard calls them. */
  number(names: readonly string[]): void {
    this.numbered = names;
    for (const node of this.nodes) if (node && names.includes(node.name) && !this.labels.has(node)) this.add(node);
  }

  private add(node: Object3D): void {
    const digits = /\d+$/.exec(node.name)?.[0];
    if (!digits) return;
    const label = new Label();
    label.say(digits, '#17212e', 'normal', TALL);
    label.sprite.name = `number ${digits}`;
    label.sprite.center.set(0.5, BELOW);
    label.sprite.layers.set(SCOPE_LIGHT);
    label.sprite.visible = this.labelled;
    node.add(label.sprite);
    this.labels.set(node, label);
  }

  /** Return the drawn position of an object in the world frame. For tests. */
  at(name: string): number[] {
    return this.nodes.find((node) => node?.name === name)?.position.toArray() ?? [];
  }
}
