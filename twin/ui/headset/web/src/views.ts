/** Two views: through the endoscope and of the room; one is large, the other is in its corner. */

import {
  AmbientLight,
  type LineSegments,
  MathUtils,
  type Mesh,
  type Object3D,
  PerspectiveCamera,
  Quaternion,
  SpotLight,
  Vector3,
  type WebGLRenderTarget,
} from 'three';
import type { App } from './app';
import { Backdrop } from './backdrop';
import { type Eye, EYES, Eyes } from './eyes';
import { Halves } from './halves';
import { lineOf } from './line';
import type { CameraInfo } from './protocol';
import { poseOf } from './robot';

export type View = 'scope' | 'room';

/**
 * Display of both lenses on a screen: one picture; side by side beside the controls; in both halves of the window, for
 * monitors that stretch each half; combined for red-cyan glasses; or in alternating rows, for polarised monitors.
 */
export type Stereo = 'one' | 'side' | 'halves' | 'red-cyan' | 'rows';

interface Point {
  x: number;
  y: number;
}

export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

const SEEN = 0.4; // m: maximum distance drawn in the endoscope's view, which shows only the cavity
const REST = 200; // ms between two updates of the small view while the large view changes
/** On slow graphics, the small view is drawn after `PAUSE` ms without motion, or at the latest after `LONG_REST` ms. */
const PAUSE = 600;
const LONG_REST = 10000;
/** Headings of the two pictures of a scene with a window of tools. */
const NAMES: Readonly<Record<View, string>> = { room: 'Patient and robots', scope: 'Inside the abdomen' };
const CLOSER = 1.9; // enlargement of the small view of the room beside a window of tools
export const SCOPE_LIGHT = 4; // layer of the endoscope's light, and of what only the endoscope sees
const TITLE = 56; // height in pixels of title and folded controls on a low page
const ABOVE = 128; // height in pixels of the window of tools on a narrow page
const ABOVE_FINGERS = 104; // the same for fingers, which need higher buttons: only the buttons
const LABELLED = 180; // smallest width in pixels of the small view whose label says that a click enlarges it
const BESIDE = 275; // largest width in pixels of the small view on a page that is at most 1400 pixels wide
const PART = 0.3; // width of the small view as a fraction of the free width
const UP = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), Math.PI); // from -y up, along z, to y up, along -z

export class Views {
  large: View = 'scope';
  /** Bottom in pixels of a window over the whole width at the top; 0: there is none. */
  high = 0;
  readonly scope: PerspectiveCamera;
  readonly backdrop: Backdrop;
  /** Whether the left eye has the odd rows instead of the even ones. */
  swapped = false;
  private stereo: Stereo = 'one';
  private readonly eyes: Eyes;
  private readonly halves: Halves;
  /** Camera of the room's view on a screen. */
  private onlooker = new PerspectiveCamera();
  private readonly frame = document.createElement('button');
  private readonly small = document.createElement('canvas');
  private readonly label = document.createElement('span');
  private readonly heading = document.createElement('span');
  private drawn = -Infinity;
  /** Whether the last picture had the small view; the next one has not, because such pictures do not count for the quality. */
  private both = false;
  private shadows = false;

  constructor(
    private readonly app: App,
    private readonly camera: CameraInfo,
    parent: HTMLElement,
    /** Whether the large picture has a heading too. */
    private readonly headed: boolean,
  ) {
    this.scope = new PerspectiveCamera(MathUtils.radToDeg(camera.view), 1, 0.003, SEEN);
    this.eyes = new Eyes(camera.stereo);
    this.backdrop = new Backdrop(app.world);
    this.halves = new Halves(parent);
    for (const lens of [this.scope, this.eyes.left, this.eyes.right]) lens.layers.enable(SCOPE_LIGHT);
    this.frame.className = 'inset';
    this.frame.dataset['id'] = 'inset';
    this.frame.append(this.small);
    this.label.className = 'inset-name';
    this.heading.className = 'inset-name heading';
    this.heading.dataset['id'] = 'heading';
    this.heading.hidden = !headed;
    parent.append(this.frame, this.label, this.heading);
    this.frame.onclick = () => this.swap();
    window.addEventListener('resize', () => this.place());
  }

  /** Attach the endoscope's camera to its robot, with a light that reaches to the walls of the cavity. */
  mount(): void {
    const member = this.app.members.find((m) => m.model.info?.name === this.camera.robot);
    const node = member?.robot?.links.get(this.camera.link)?.node;
    if (!node) return;
    const { p, q } = poseOf(this.camera.T_link_camera);
    this.scope.position.copy(p);
    this.scope.quaternion.copy(q).multiply(UP);
    node.add(this.scope);
    for (const m of this.app.members) m.handle.group.visible = false; // robots of a console cannot be grabbed
    // The lamps of the room do not light the cavity: only the endoscope's light and its scattered light do.
    const light = new SpotLight(0xffffff, 2.6, 0.5, 0.9, 0.6, 0);
    const scattered = new AmbientLight(0xffe0d0, 0.9);
    light.position.set(0, 0, 0); // at the camera; by default, three.js places lights above the origin
    light.target.position.set(0, 0, -0.1);
    for (const lamp of [light, scattered]) lamp.layers.set(SCOPE_LIGHT);
    this.scope.add(light, light.target, scattered);
    const { line, view, stereo } = this.camera;
    if (line !== undefined) this.scope.add(lineOf(line, view, SCOPE_LIGHT, stereo?.[1]));
    const { world } = this.app;
    this.onlooker = world.camera.clone();
    this.onlooker.clearViewOffset();
    world.placement.attach(this.onlooker);
    this.place();
  }

  swap(): void {
    this.large = this.large === 'scope' ? 'room' : 'scope';
    this.place();
    this.app.refresh();
  }

  /** Whether the endoscope has two lenses. */
  get twoLenses(): boolean {
    return this.camera.stereo !== undefined;
  }

  get mode(): Stereo {
    return this.stereo;
  }

  setMode(mode: Stereo): void {
    this.stereo = mode;
    this.halves.show(mode === 'halves');
    this.app.world.pace.exact = mode === 'rows'; // a canvas with fewer pixels would be stretched over the rows
    this.place();
    this.app.world.touch();
    this.app.refresh();
  }

  /** Exchange the rows of both eyes. */
  swapRows(): void {
    this.swapped = !this.swapped;
    this.app.world.touch();
    this.app.refresh();
  }

  /** Return the box of a view in pixels of the page. */
  box(view: View): Box {
    const { clientWidth: w, clientHeight: h } = this.app.world.renderer.domElement;
    if (view === this.large) return { left: 0, top: 0, width: w, height: h };
    const [right, bottom] = this.app.world.free();
    const widest = window.innerWidth > 1400 ? 420 : BESIDE;
    const width = Math.round(Math.min(PART * right, widest, 0.6 * bottom));
    const height = Math.round(0.62 * width);
    return { left: 18, top: bottom - height - (this.headed && !this.flat ? 40 : 18), width, height };
  }

  /** Return the box of the small view in pixels of the page. */
  get corner(): Box {
    return this.box(this.large === 'scope' ? 'room' : 'scope');
  }

  /** Return the box of the window of tools: beside the small view, or above it if the page is narrow. */
  get beside(): Box {
    const b = this.corner;
    const [right] = this.app.world.free();
    const left = b.left + b.width + 12;
    if (right - left - 12 >= 260) return { left, top: b.top, width: right - left - 12, height: b.height };
    const height = window.matchMedia('(pointer: coarse)').matches ? ABOVE_FINGERS : ABOVE;
    return { left: b.left, top: b.top - height - 10, width: right - 2 * b.left, height };
  }

  /** Whether the page is so low, as on a phone on its side, that it has neither help nor headings (see style.css). */
  get flat(): boolean {
    return window.innerHeight <= 480;
  }

  /** Top in pixels of the windows at the bottom. */
  get low(): number {
    return this.headed ? Math.min(this.corner.top, this.beside.top) : this.corner.top;
  }

  /** Width and height in pixels of the area without controls at the right and the bottom. */
  get free(): [right: number, bottom: number] {
    return this.app.world.free();
  }

  /** Return the view at a point of the page. */
  at(x: number, y: number): View {
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const b = this.box(small);
    if (this.stereo === 'halves') x = 2 * (x % (window.innerWidth / 2)); // each half has the whole page, compressed
    return x >= b.left && y >= b.top && x < b.left + b.width && y < b.top + b.height ? small : this.large;
  }

  place(): void {
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const b = this.box(small);
    for (const [key, value] of Object.entries(b)) this.frame.style.setProperty(key, `${value}px`);
    // A click on the small view of the room enlarges it; in the endoscope's view, the mouse moves instruments.
    this.frame.classList.toggle('work', small === 'scope');
    this.label.style.left = `${b.left + 8}px`;
    this.label.style.top = `${b.top + 4}px`;
    this.label.style.maxWidth = `${b.width - 16}px`;
    const own = this.camera.name === 'microscope' ? 'Microscope' : 'Endoscope';
    const names = this.headed ? NAMES : { room: 'Room', scope: own };
    const name = small === 'room' ? `${names.room} · click to enlarge` : names.scope;
    this.label.textContent = b.width < LABELLED ? names[small] : name;
    this.heading.textContent = this.large === 'scope' ? `${names.scope}, through the endoscope` : names.room;
    const right = Math.min(this.app.world.free()[0], this.app.dom.left);
    this.heading.style.maxWidth = `${Math.max(0, right - this.heading.offsetLeft - 12)}px`;
    this.frame.setAttribute('aria-label', name);
  }

  /** Project a point of the scene into a view, in pixels of the page; side by side: into the picture nearer to x. */
  project(point: Vector3, view: View, x = 0): { x: number; y: number } {
    const two = this.sideBySide(view);
    if (!two) return this.into(point, this.fit(view), this.box(view));
    this.follow(two);
    const [left, right] = EYES.map((eye) => this.into(point, this.eyes[eye], two[eye])) as [Point, Point];
    return x < two.right.left ? left : right;
  }

  private into(point: Vector3, camera: PerspectiveCamera, b: Box): Point {
    const v = point.clone().project(camera);
    return { x: b.left + (b.width * (1 + v.x)) / 2, y: b.top + (b.height * (1 - v.y)) / 2 };
  }

  /** Return the pixels of a view per radian at its middle. */
  pixels(view: View): number {
    const fov = view === 'scope' ? this.camera.view : MathUtils.degToRad(this.app.world.camera.fov);
    const two = this.sideBySide(view);
    const zoom = view === 'scope' && (!two || this.stereo === 'halves') ? this.fit(view).zoom : 1;
    return (zoom * (two?.left ?? this.box(view)).height) / (2 * Math.tan(fov / 2));
  }

  /** Return the boxes of both eyes in the area without controls, or in the window; null unless they are side by side. */
  private sideBySide(view: View): Record<Eye, Box> | null {
    if (view !== 'scope' || this.large !== 'scope' || (this.stereo !== 'side' && this.stereo !== 'halves')) return null;
    const whole = this.box(view);
    const [right, bottom] = this.stereo === 'side' ? this.app.world.free() : [whole.width, whole.height];
    const width = Math.floor(right / 2);
    const half = (left: number): Box => ({ left, top: 0, width, height: bottom });
    return { left: half(0), right: half(width) };
  }

  /** Set the cameras of both lenses for two boxes; a half of the window has the whole picture, compressed. */
  private follow(two: Record<Eye, Box>): void {
    if (this.stereo === 'side') this.aim(two.left.width / two.left.height);
    else {
      this.fit('scope');
      this.eyes.follow(this.scope);
    }
  }

  /** Draw the large view and, less often, the small one. */
  render(): void {
    const { pace, renderer, moved } = this.app.world;
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const now = performance.now();
    // Shadows of the room are not visible in the cavity.
    this.shadows ||= renderer.shadowMap.needsUpdate;
    const due = !this.both && now - this.drawn > (pace.slow && now - moved < PAUSE ? LONG_REST : REST);
    this.both = due;
    if (small === 'scope' || due) {
      if (due) pace.except();
      this.drawn = now;
      this.drawLit(small);
      const { left, top, width, height } = this.box(small);
      const scale = renderer.getPixelRatio();
      const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
      if (this.small.width !== w || this.small.height !== h) [this.small.width, this.small.height] = [w, h];
      const whole = this.small.getContext('2d');
      whole?.drawImage(renderer.domElement, left * scale, top * scale, w, h, 0, 0, w, h);
    } else this.app.later(pace.slow ? PAUSE : REST);
    this.drawLit(this.large);
    this.halves.refresh();
  }

  /** Draw the pictures of both lenses for a headset, with this size in pixels. */
  drawEyes(width: number, height: number): Record<Eye, WebGLRenderTarget> {
    this.aim(width / height);
    const pictures = { left: this.eyes.picture('left', width, height), right: this.eyes.picture('right', width, height) };
    const { reflections } = this.app.world;
    reflections.inside(() => {
      for (const eye of EYES) this.drawInto(pictures[eye], this.eyes[eye], true);
    });
    return pictures;
  }

  /** Draw the room's view of a screen, for a headset. */
  drawRoom(picture: WebGLRenderTarget): void {
    this.onlooker.aspect = picture.width / picture.height;
    this.onlooker.updateProjectionMatrix();
    this.onlooker.updateWorldMatrix(true, false);
    this.drawInto(picture, this.onlooker, false);
  }

  private drawInto(picture: WebGLRenderTarget, camera: PerspectiveCamera, inside: boolean): void {
    const { renderer, scene, placement } = this.app.world;
    // Panels and screens of the headset's user are not drawn in this view.
    const others = scene.children.filter((o) => o !== placement && o.visible && !('isLight' in o));
    const hidden = [...others, ...(inside ? this.about() : [])];
    const [xr, background, shown] = [renderer.xr.enabled, scene.background, placement.visible];
    const [target, shadows] = [renderer.getRenderTarget(), renderer.shadowMap.needsUpdate];
    renderer.shadowMap.needsUpdate = false;
    for (const thing of hidden) thing.visible = false;
    placement.visible = true;
    renderer.xr.enabled = false;
    scene.background = this.app.world.sky;
    renderer.setRenderTarget(picture);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(target);
    renderer.shadowMap.needsUpdate = shadows;
    renderer.xr.enabled = xr;
    scene.background = background;
    placement.visible = shown;
    for (const thing of hidden) thing.visible = true;
  }

  /** Draw a view by its own light. */
  private drawLit(view: View): void {
    if (view === 'scope') this.app.world.reflections.inside(() => this.draw(view));
    else this.draw(view);
  }

  private draw(view: View): void {
    const { renderer, scene } = this.app.world;
    const whole = this.box(view);
    if (whole.width < 1 || whole.height < 1) return;
    renderer.shadowMap.needsUpdate = view === 'room' && this.shadows;
    if (view === 'room') this.shadows = false;
    const hidden = view === 'scope' ? this.about() : [];
    for (const thing of hidden) thing.visible = false;
    const two = this.sideBySide(view);
    renderer.setScissorTest(true);
    if (two) {
      this.inBox(whole, () => renderer.clear());
      this.follow(two);
      for (const eye of EYES) this.inBox(two[eye], () => renderer.render(scene, this.eyes[eye]));
    } else if (view === 'scope' && view === this.large && (this.stereo === 'red-cyan' || this.stereo === 'rows')) {
      const how = this.stereo;
      this.fit(view);
      this.eyes.follow(this.scope);
      const scale = renderer.getPixelRatio();
      for (const eye of EYES) {
        renderer.setRenderTarget(this.eyes.picture(eye, Math.round(whole.width * scale), Math.round(whole.height * scale)));
        renderer.render(scene, this.eyes[eye]);
      }
      renderer.setRenderTarget(null);
      this.inBox(whole, () => this.eyes.overlay(renderer, how, this.swapped));
    } else {
      const camera = this.fit(view);
      const copies = view === 'scope' && view === this.large && this.app.world.pace.reduced;
      this.inBox(whole, () => (copies ? this.backdrop.draw(camera, this.still()) : renderer.render(scene, camera)));
    }
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, renderer.domElement.clientWidth, renderer.domElement.clientHeight);
    for (const thing of hidden) thing.visible = true;
  }

  private inBox({ left, top, width, height }: Box, draw: () => void): void {
    const { renderer } = this.app.world;
    const area = [left, renderer.domElement.clientHeight - top - height, width, height] as const;
    renderer.setViewport(...area);
    renderer.setScissor(...area);
    draw();
  }

  /** Return the parts of the scene that never move. */
  private still(): (Mesh | LineSegments)[] {
    return [...this.app.world.ground, ...this.app.surroundings.parts, ...this.app.drawn.still];
  }

  /** Return the visible displays that are only for the room's view. */
  private about(): Object3D[] {
    const { members, surroundings } = this.app;
    const drawn = members.flatMap((m) => m.place.children.filter((o) => o !== m.robot?.root));
    return [...drawn, ...surroundings.signs].filter((o) => o.visible);
  }

  /** Set the aspect ratio of both lenses. */
  private aim(aspect: number): void {
    this.scope.aspect = aspect;
    this.scope.zoom = 1;
    this.scope.clearViewOffset();
    this.scope.updateWorldMatrix(true, false);
    this.eyes.follow(this.scope);
  }

  private fit(view: View): PerspectiveCamera {
    const { world } = this.app;
    const camera = view === 'scope' ? this.scope : world.camera;
    const b = this.box(view);
    const [right, bottom] = world.free();
    const large = view === this.large;
    camera.aspect = b.width / b.height;
    const low = this.headed ? this.low : bottom; // above the small windows
    const width = right - world.beside;
    const high = this.flat && !this.headed ? TITLE : this.high;
    const [x, y] = large ? [(b.width - right - world.beside) / 2, (b.height - low - high) / 2] : [0, 0];
    // Between the panels, a narrow picture is reduced to show as much to the sides as upwards; a low one shows its middle.
    const fits = Math.min(width / (this.headed ? this.corner.top : bottom), this.flat ? (low - high) / bottom : 1);
    if (view === 'scope') camera.zoom = large ? Math.min(1, fits) : 1;
    else camera.zoom = large || !this.headed ? 1 : CLOSER;
    camera.setViewOffset(b.width, b.height, x, y, b.width, b.height);
    if (view === 'scope') this.scope.updateWorldMatrix(true, false);
    return camera;
  }
}
