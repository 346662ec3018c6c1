/** Mouse and touch on the desktop: grab the robot, drag it parallel to the screen, rotate it with Shift. */

import { Plane, Quaternion, Raycaster, Vector2, Vector3 } from 'three';
import type { App } from './app';
import { type Hit, pickRay } from './pick';

export class Mouse {
  private readonly caster = new Raycaster();
  private readonly plane = new Plane();
  private readonly at = new Vector2();
  private point = new Vector3();
  private turn = new Quaternion();
  private last = new Vector2();
  private moved = false;
  private pointer: number | null = null;

  constructor(private readonly app: App) {
    const canvas = app.world.renderer.domElement;
    const capture = { capture: true };
    canvas.addEventListener('pointerdown', (e) => this.down(e), capture);
    canvas.addEventListener('pointermove', (e) => this.move(e), capture);
    canvas.addEventListener('pointerup', (e) => this.up(e), capture);
    canvas.addEventListener('pointercancel', (e) => this.up(e), capture);
    canvas.addEventListener('wheel', (e) => this.wheel(e), { capture: true, passive: false });
    canvas.addEventListener('pointerleave', () => this.app.grab.hover(null));
  }

  /** Highlight the part under a mouse that has moved; called for each picture. */
  update(): void {
    const { app } = this;
    if (!this.moved || app.xr.presenting || this.pointer !== null || app.console) return;
    this.moved = false;
    const hit = this.pick();
    app.grab.hover(hit);
    app.world.renderer.domElement.style.cursor = hit ? 'grab' : '';
  }

  private pick(): Hit | null {
    const { members, world } = this.app;
    this.caster.setFromCamera(this.at, world.camera);
    return pickRay(this.caster, members);
  }

  private read(e: PointerEvent): void {
    const box = this.app.world.renderer.domElement.getBoundingClientRect();
    this.at.set(((e.clientX - box.left) / box.width) * 2 - 1, 1 - ((e.clientY - box.top) / box.height) * 2);
  }

  private down(e: PointerEvent): void {
    const { app } = this;
    if (e.button !== 0 || this.pointer !== null || app.xr.presenting || app.console) return;
    this.read(e);
    const hit = this.pick();
    if (!hit || !app.take(hit)) return;
    const canvas = app.world.renderer.domElement;
    this.pointer = e.pointerId;
    canvas.setPointerCapture(e.pointerId);
    canvas.style.cursor = 'grabbing';
    app.world.orbit.enabled = false;
    this.point.copy(hit.point);
    this.turn.identity();
    this.last.set(e.clientX, e.clientY);
    e.stopImmediatePropagation();
  }

  private move(e: PointerEvent): void {
    this.read(e);
    this.moved = true;
    if (e.pointerId !== this.pointer) return;
    const { camera } = this.app.world;
    if (e.shiftKey) {
      const [dx, dy] = [e.clientX - this.last.x, e.clientY - this.last.y];
      const up = new Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
      const right = new Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
      this.turn.premultiply(new Quaternion().setFromAxisAngle(up, dx * 0.008));
      this.turn.premultiply(new Quaternion().setFromAxisAngle(right, dy * 0.008));
    } else {
      const normal = camera.getWorldDirection(new Vector3());
      this.plane.setFromNormalAndCoplanarPoint(normal, this.point);
      this.caster.setFromCamera(this.at, camera);
      this.caster.ray.intersectPlane(this.plane, this.point);
    }
    this.last.set(e.clientX, e.clientY);
    this.app.grab.move(this.point, this.turn);
  }

  private wheel(e: WheelEvent): void {
    if (this.pointer === null) return;
    const { camera } = this.app.world;
    const away = this.point.clone().sub(camera.position);
    this.point.addScaledVector(away, -Math.sign(e.deltaY) * 0.01);
    this.app.grab.move(this.point, this.turn);
    e.preventDefault();
    e.stopImmediatePropagation();
  }

  private up(e: PointerEvent): void {
    if (e.pointerId !== this.pointer) return;
    this.pointer = null;
    this.app.world.renderer.domElement.style.cursor = '';
    this.app.world.orbit.enabled = true;
    this.app.grab.end();
  }
}
