/** Forces on the hands, as the server computes them: arrows at the instruments, and the strength of vibrations. */

import { ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Quaternion, Vector3 } from 'three';
import type { App } from './app';
import type { Console } from './console';
import { SIDES } from './pens';
import type { Message, Side } from './protocol';

const LARGEST = 3.3; // N: force of the strongest vibration
const LEAST = 0.05; // N: smallest force that is shown
const LENGTH = 0.006; // m of arrow per N
const HEAD = 0.005; // m: length of the arrow's head
const COLOR = 0x2dff8f;
const UP = new Vector3(0, 1, 0);

export class Forces {
  /** Force in N on each hand in the axes of the picture: x right, y up, z out of it. */
  readonly now: Record<Side, Vector3> = { right: new Vector3(), left: new Vector3() };
  /** Arrows along y, from their origin. */
  readonly arrows: Record<Side, Group>;

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {
    this.arrows = { right: this.arrow(), left: this.arrow() };
  }

  hear(message: Extract<Message, { type: 'forces' }>): void {
    for (const side of SIDES) this.now[side].fromArray(message[side] as number[]);
    this.app.world.dirty = true;
  }

  /** Return the strength of a vibration, 0 to 1. */
  strength(side: Side): number {
    const size = this.now[side].length();
    return size < LEAST ? 0 : Math.min(1, size / LARGEST);
  }

  /** Move the arrows to the tips of the instruments; called for each picture. */
  update(): void {
    const { scope } = this.console.views;
    const turn = scope.getWorldQuaternion(new Quaternion());
    const scale = scope.matrixWorld.getMaxScaleOnAxis();
    for (const side of SIDES) {
      const [arrow, force, tip] = [this.arrows[side], this.now[side], this.console.tip(side)];
      arrow.visible = tip !== null && force.length() >= LEAST;
      if (!arrow.visible || !tip) continue;
      const length = LENGTH * force.length();
      arrow.position.copy(tip);
      arrow.quaternion.setFromUnitVectors(UP, force.clone().normalize().applyQuaternion(turn));
      arrow.scale.setScalar(scale);
      const [shaft, head] = arrow.children as [Mesh, Mesh];
      shaft.scale.y = length;
      head.position.y = length;
    }
  }

  text(): string {
    const state = this.app.model.console;
    if (!state?.haptics) return 'Forces: off';
    return `Forces: ${SIDES.toReversed().map((side) => `${side} ${this.now[side].length().toFixed(1)} N`).join(', ')}`;
  }

  private arrow(): Group {
    const arrow = new Group();
    const material = new MeshBasicMaterial({ color: COLOR, depthTest: false, transparent: true }); // seen through the tool
    const shaft = new Mesh(new CylinderGeometry(0.0006, 0.0006, 1).translate(0, 0.5, 0), material);
    const head = new Mesh(new ConeGeometry(0.0018, HEAD).translate(0, HEAD / 2, 0), material);
    arrow.add(shaft, head);
    for (const part of arrow.children) part.renderOrder = 10;
    arrow.visible = false;
    this.app.world.scene.add(arrow);
    return arrow;
  }
}
