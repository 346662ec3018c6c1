/** Touch in the endoscope's picture: one finger drags the nearest instrument, two move, zoom and roll the camera. */

import type { App } from './app';
import type { Console } from './console';
import type { Side } from './protocol';

const SLOP = 8; // pixels that a finger may move before it drags, so that a second finger can follow

interface Point {
  x: number;
  y: number;
}

export class ConsoleTouch {
  /** Fingers on the picture, in the order of their first contact. */
  private readonly fingers = new Map<number, Point>();
  private side: Side = 'right';
  private doing: 'nothing' | 'waiting' | 'instrument' | 'camera' = 'nothing';
  private begun: Point = { x: 0, y: 0 };

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {
    const canvas = app.world.renderer.domElement;
    const capture = { capture: true };
    canvas.addEventListener('pointerdown', (e) => this.down(e), capture);
    canvas.addEventListener('pointermove', (e) => this.move(e), capture);
    canvas.addEventListener('pointerup', (e) => this.up(e), capture);
    canvas.addEventListener('pointercancel', (e) => this.up(e), capture);
  }

  private down(e: PointerEvent): void {
    if (e.pointerType !== 'touch' || !this.console.works(e.clientX, e.clientY)) return;
    e.stopImmediatePropagation(); // prevents rotation of the room's view
    const { console } = this;
    this.app.world.renderer.domElement.setPointerCapture(e.pointerId);
    this.fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (this.fingers.size === 1) {
      this.begun = { x: e.clientX, y: e.clientY };
      this.side = console.nearest(e.clientX, e.clientY);
      this.doing = 'waiting';
    } else if (this.fingers.size === 2) {
      this.doing = 'camera';
      console.pens.press('camera', 'touch', true);
    }
    console.chosen = this.side;
    console.enable('touch', true);
    console.pens.use();
  }

  private move(e: PointerEvent): void {
    const last = this.fingers.get(e.pointerId);
    if (!last) return;
    e.stopImmediatePropagation();
    const { console } = this;
    const at = { x: e.clientX, y: e.clientY };
    if (this.doing === 'waiting') {
      if (Math.hypot(at.x - this.begun.x, at.y - this.begun.y) < SLOP) return;
      this.doing = 'instrument';
    }
    const [first, second] = [...this.fingers.keys()];
    const other = this.fingers.get((e.pointerId === first ? second : first) as number);
    this.fingers.set(e.pointerId, at);
    const [dx, dy] = [at.x - last.x, at.y - last.y];
    if (this.doing === 'instrument') console.move(this.side, console.perPixel * dx, -console.perPixel * dy, 0);
    if (this.doing !== 'camera' || !other || ![first, second].includes(e.pointerId)) return;
    // Each event moves one finger, so the midpoint moves by half of its motion.
    console.move(this.side, (console.perPixel * dx) / 2, (-console.perPixel * dy) / 2, 0);
    const [was, is] = [apart(other, last), apart(other, at)];
    if (was.length < 1 || is.length < 1) return;
    console.zoom(is.length / was.length);
    const turn = was.angle - is.angle; // the page's y axis points down
    console.turn(this.side, 0, 0, Math.atan2(Math.sin(turn), Math.cos(turn)));
  }

  /** Handle a lifted finger. The remaining one of two fingers moves nothing, because it was not meant for an instrument. */
  private up(e: PointerEvent): void {
    if (!this.fingers.delete(e.pointerId)) return;
    e.stopImmediatePropagation();
    this.doing = 'nothing';
    this.console.pens.press('camera', 'touch', false);
    this.console.enable('touch', false);
  }
}

function apart(from: Point, to: Point): { length: number; angle: number } {
  return { length: Math.hypot(to.x - from.x, to.y - from.y), angle: Math.atan2(to.y - from.y, to.x - from.x) };
}
