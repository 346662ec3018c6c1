/** Mouse in the endoscope's picture: left button: instrument, right button: camera, wheel: depth. */

import type { App } from './app';
import type { Console } from './console';
import type { Side } from './protocol';

const TURN = 0.008; // rad per pixel
const NOTCH = 0.006; // hand motion in m per notch of the wheel
const ROLL = 0.12; // rad per notch

export class ConsoleMouse {
  private pointer: number | null = null;
  private side: Side = 'right';
  private last = { x: 0, y: 0 };

  constructor(
    private readonly app: App,
    private readonly console: Console,
  ) {
    const canvas = app.world.renderer.domElement;
    canvas.addEventListener('pointerdown', (e) => this.down(e), { capture: true });
    canvas.addEventListener('pointermove', (e) => this.move(e), { capture: true });
    // Comes with each report of the mouse; pointermove waits for the next picture. Only Chromium has it.
    canvas.addEventListener('pointerrawupdate', (e) => this.move(e as PointerEvent), { capture: true });
    canvas.addEventListener('pointerup', (e) => this.up(e), { capture: true });
    canvas.addEventListener('pointercancel', (e) => this.up(e), { capture: true });
    canvas.addEventListener('wheel', (e) => this.wheel(e), { capture: true, passive: false });
    canvas.addEventListener('contextmenu', (e) => e.preventDefault());
  }

  /** Whether an event is of a mouse in the endoscope's picture; touch is handled in `console_touch`. */
  private works(e: MouseEvent): boolean {
    return (e as PointerEvent).pointerType !== 'touch' && this.console.works(e.clientX, e.clientY);
  }

  private down(e: PointerEvent): void {
    if (!this.works(e)) return;
    e.stopImmediatePropagation(); // prevents rotation of the room's view
    if (this.pointer !== null) return;
    const canvas = this.app.world.renderer.domElement;
    canvas.focus();
    this.pointer = e.pointerId;
    canvas.setPointerCapture(e.pointerId);
    this.side = this.console.nearest(e.clientX, e.clientY);
    this.console.chosen = this.side;
    this.console.pens.use();
    if (e.button === 2) this.console.pens.press('camera', 'mouse', true);
    this.console.enable('mouse', true);
    this.last = { x: e.clientX, y: e.clientY };
    canvas.style.cursor = 'grabbing';
  }

  private move(e: PointerEvent): void {
    const canvas = this.app.world.renderer.domElement;
    if (this.pointer === null) canvas.style.cursor = this.works(e) ? 'crosshair' : '';
    if (e.pointerId !== this.pointer) return;
    e.stopImmediatePropagation();
    const [dx, dy] = [e.clientX - this.last.x, e.clientY - this.last.y];
    if (!dx && !dy) return;
    this.last = { x: e.clientX, y: e.clientY };
    const { console, side } = this;
    if (e.shiftKey) console.turn(side, TURN * dy, TURN * dx, 0);
    else console.move(side, console.perPixel * dx, -console.perPixel * dy, 0);
    console.pens.say(performance.now());
  }

  private wheel(e: WheelEvent): void {
    if (!this.works(e)) return;
    e.preventDefault();
    e.stopImmediatePropagation();
    const by = Math.sign(e.deltaY || e.deltaX);
    const side = this.pointer === null ? this.console.nearest(e.clientX, e.clientY) : this.side;
    this.console.notch(side, e.shiftKey, by, NOTCH, ROLL);
  }

  private up(e: PointerEvent): void {
    if (e.pointerId !== this.pointer) return;
    e.stopImmediatePropagation();
    this.pointer = null;
    this.console.pens.press('camera', 'mouse', false);
    this.console.enable('mouse', false);
    this.app.world.renderer.domElement.style.cursor = '';
  }
}
