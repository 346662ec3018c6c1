/** A moving hint where the first drag begins: at an instrument of a console, or at the blue ring of a robot. */

import { Vector3 } from 'three';
import type { App } from './app';

const STILL = 0.5; // px: a smaller motion of the hint is not drawn
const HERE = 'Drag here';
/** Where no instrument is in the picture. */
const ANYWHERE = 'Drag anywhere';
const WIDTH = 170; // px: space for the words at the right of the point; without it, they are at its left

export class Coach {
  private readonly box = document.createElement('div');
  private readonly words = document.createElement('span');
  /** Whether this page has dragged something; the hint then never comes back. */
  private done = false;
  private x = NaN;
  private y = NaN;

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    this.box.className = 'coach';
    this.box.dataset['id'] = 'coach';
    this.box.hidden = true;
    const dot = document.createElement('i');
    dot.setAttribute('aria-hidden', 'true');
    this.words.textContent = HERE;
    this.box.append(dot, this.words);
    parent.append(this.box);
  }

  /** Show, move or hide the hint; called with the other controls. */
  refresh(): void {
    const at = this.place();
    this.box.hidden = at === null;
    if (!at) return;
    if (Math.hypot(at.x - this.x, at.y - this.y) < STILL) return;
    this.x = at.x;
    this.y = at.y;
    this.box.style.left = `${at.x}px`;
    this.box.style.top = `${at.y}px`;
    const [free] = this.app.world.free(); // words beside the controls, not over them
    this.box.classList.toggle('left', at.x + WIDTH > Math.min(free, window.innerWidth));
  }

  /** Return the point of the page where a drag begins, and set the words; null if no hint is needed, or if something covers the point. */
  private place(): { x: number; y: number } | null {
    const { app } = this;
    if (this.done || app.xr.presenting || app.model.line !== 'open') return null;
    const at = app.console ? this.instrument() : this.ring();
    this.words.textContent = HERE;
    if (!at || this.inPicture(at)) return at;
    if (!app.console) return null;
    // the tip is outside of the picture: a drag anywhere moves the nearest instrument
    const [right, bottom] = app.console.views.free;
    this.words.textContent = ANYWHERE;
    const middle = { x: right / 2, y: bottom / 2 };
    return this.inPicture(middle) ? middle : null;
  }

  /** Whether nothing covers the picture at a point of the page. */
  private inPicture(at: { x: number; y: number }): boolean {
    return document.elementFromPoint(at.x, at.y) === this.app.world.renderer.domElement;
  }

  private instrument(): { x: number; y: number } | null {
    const { console, model } = this.app;
    if (!console || !model.console) return null;
    if (console.pens.active) this.done = true;
    const waits = console.forms.due !== null || Boolean(model.console.task?.over);
    const busy = model.console.owner !== null || console.plan.phase !== 'off' || waits;
    if (this.done || busy || console.views.large !== 'scope') return null;
    const tip = console.tip('right');
    return tip ? console.views.project(tip, 'scope') : null;
  }

  private ring(): { x: number; y: number } | null {
    const { members, model, world } = this.app;
    if (model.robots.some((robot) => robot.holding)) this.done = true;
    const handle = members[0]?.handle.group;
    if (this.done || !handle?.visible || model.state.playing || members.length !== 1) return null;
    const at = handle.getWorldPosition(new Vector3()).project(world.camera);
    if (Math.abs(at.x) > 1 || Math.abs(at.y) > 1 || at.z > 1) return null;
    const { clientWidth, clientHeight } = world.renderer.domElement;
    return { x: (clientWidth * (1 + at.x)) / 2, y: (clientHeight * (1 - at.y)) / 2 };
  }
}
