/** Forces on the hands, as the server computes them: arrows at the instruments, and the strength of vibrations. */

import { ArrowHelper, type Material, Quaternion, Vector3 } from 'three';
import type { App } from './app';
import type { Console } from './console';
import { SIDES } from './pens';
import type { Message, Side } from './protocol';

const LARGEST = 3.3; // N: force of the strongest vibration
const LEAST = 0.05; // N: smallest force that is shown
const LENGTH = 0.006; // m of arrow per N
const COLOR = 0xffb000;

export class Forces {
  /** Force in N on each hand in the axes of the picture: x right, y up, z out of it. */
  readonly now: Record<Side, Vector3> = { right: new Vector3(), left: new Vector3() };
  readonly arrows: Record<Side, ArrowHelper>;

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
      const length = LENGTH * force.length() * scale;
      arrow.position.copy(tip);
      arrow.setDirection(force.clone().normalize().applyQuaternion(turn));
      arrow.setLength(length, Math.min(0.4 * length, 0.004 * scale), 0.003 * scale);
    }
  }

  text(): string {
    const state = this.app.model.console;
    if (!state?.haptics) return 'Forces on the hands: off';
    return `Forces on the hands: ${SIDES.toReversed().map((side) => `${side} ${this.now[side].length().toFixed(1)} N`).join(', ')}`;
  }

  private arrow(): ArrowHelper {
    const arrow = new ArrowHelper(new Vector3(0, 1, 0), new Vector3(), 1, COLOR);
    for (const part of [arrow.line, arrow.cone]) {
      part.renderOrder = 10;
      (part.material as Material).depthTest = false; // visible through the instrument
    }
    arrow.visible = false;
    this.app.world.scene.add(arrow);
    return arrow;
  }
}
