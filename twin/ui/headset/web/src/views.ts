/** Two pictures: through the endoscope and of the room, one large and one in its corner. */

import { MathUtils, type Object3D, PerspectiveCamera, Quaternion, SpotLight, Vector3 } from 'three';
import type { App } from './app';
import type { CameraInfo } from './protocol';
import { poseOf } from './robot';

export type View = 'scope' | 'room';

export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

const SEEN = 0.4; // m that the endoscope sees: what lies beyond the cavity is not drawn
const REST = 200; // ms between two of the small picture while the large one moves
const PART = 0.3; // of the free width that the small picture takes
const UP = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), Math.PI); // from -y up, along z, to y up, along -z

export class Views {
  large: View = 'scope';
  readonly scope: PerspectiveCamera;
  private readonly frame = document.createElement('button');
  private readonly small = document.createElement('canvas');
  private readonly label = document.createElement('span');
  private drawn = -Infinity;
  private shadows = false;

  constructor(
    private readonly app: App,
    private readonly camera: CameraInfo,
    parent: HTMLElement,
  ) {
    this.scope = new PerspectiveCamera(MathUtils.radToDeg(camera.view), 1, 0.003, SEEN);
    this.frame.className = 'inset';
    this.frame.dataset['id'] = 'inset';
    this.frame.append(this.small);
    this.label.className = 'inset-name';
    parent.append(this.frame, this.label);
    this.frame.onclick = () => this.swap();
    window.addEventListener('resize', () => this.place());
  }

  /** Mount the endoscope on its robot, with a light that reaches as far as the cavity. */
  mount(): void {
    const member = this.app.members.find((m) => m.model.info?.name === this.camera.robot);
    const node = member?.robot?.links.get(this.camera.link)?.node;
    if (!node) return;
    const { p, q } = poseOf(this.camera.T_link_camera);
    this.scope.position.copy(p);
    this.scope.quaternion.copy(q).multiply(UP);
    node.add(this.scope);
    for (const m of this.app.members) m.handle.group.visible = false; // nobody takes it here
    const light = new SpotLight(0xffffff, 1.6, 0.4, 0.9, 0.5, 0);
    light.target.position.set(0, 0, -0.1);
    this.scope.add(light, light.target);
    this.place();
  }

  swap(): void {
    this.large = this.large === 'scope' ? 'room' : 'scope';
    this.place();
    this.app.refresh();
  }

  /** Where a picture is, in pixels of the page. */
  box(view: View): Box {
    const { clientWidth: w, clientHeight: h } = this.app.world.renderer.domElement;
    if (view === this.large) return { left: 0, top: 0, width: w, height: h };
    const [right, bottom] = this.app.world.free();
    const width = Math.round(Math.min(PART * right, 420));
    const height = Math.round(0.62 * width);
    return { left: 18, top: bottom - height - 18, width, height };
  }

  /** Which picture is under a point of the page. */
  at(x: number, y: number): View {
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const b = this.box(small);
    return x >= b.left && y >= b.top && x < b.left + b.width && y < b.top + b.height ? small : this.large;
  }

  place(): void {
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const b = this.box(small);
    for (const [key, value] of Object.entries(b)) this.frame.style.setProperty(key, `${value}px`);
    // The room is looked at from there and a click enlarges it; the endoscope's picture is worked in.
    this.frame.classList.toggle('work', small === 'scope');
    this.label.style.left = `${b.left + 8}px`;
    this.label.style.top = `${b.top + 4}px`;
    this.label.textContent = small === 'room' ? 'Room · click to enlarge' : 'Endoscope';
    this.frame.setAttribute('aria-label', this.label.textContent);
  }

  /** Where a point of the scene is in a picture, in pixels of the page. */
  project(point: Vector3, view: View): { x: number; y: number } {
    const b = this.box(view);
    this.fit(view);
    const v = point.clone().project(view === 'scope' ? this.scope : this.app.world.camera);
    return { x: b.left + (b.width * (1 + v.x)) / 2, y: b.top + (b.height * (1 - v.y)) / 2 };
  }

  /** Pixels of a picture for one radian at its middle. */
  pixels(view: View): number {
    const fov = view === 'scope' ? this.camera.view : MathUtils.degToRad(this.app.world.camera.fov);
    return this.box(view).height / (2 * Math.tan(fov / 2));
  }

  /** Draw the large picture and, if it is the room's less often, the small one. */
  render(): void {
    const { renderer } = this.app.world;
    const small: View = this.large === 'scope' ? 'room' : 'scope';
    const now = performance.now();
    // The shadows of the room are not seen in the cavity.
    this.shadows ||= renderer.shadowMap.needsUpdate;
    if (small === 'scope' || now - this.drawn > REST) {
      this.drawn = now;
      this.draw(small);
      const { left, top, width, height } = this.box(small);
      const scale = renderer.getPixelRatio();
      const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
      if (this.small.width !== w || this.small.height !== h) [this.small.width, this.small.height] = [w, h];
      const whole = this.small.getContext('2d');
      whole?.drawImage(renderer.domElement, left * scale, top * scale, w, h, 0, 0, w, h);
    } else this.app.later(REST);
    this.draw(this.large);
  }

  private draw(view: View): void {
    const { renderer, scene } = this.app.world;
    const { left, top, width, height } = this.box(view);
    if (width < 1 || height < 1) return;
    const camera = this.fit(view);
    const area = [left, renderer.domElement.clientHeight - top - height, width, height] as const;
    renderer.setViewport(...area);
    renderer.setScissor(...area);
    renderer.setScissorTest(true);
    renderer.shadowMap.needsUpdate = view === 'room' && this.shadows;
    if (view === 'room') this.shadows = false;
    const hidden = view === 'scope' ? this.hide() : [];
    renderer.render(scene, camera);
    for (const thing of hidden) thing.visible = true;
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, renderer.domElement.clientWidth, renderer.domElement.clientHeight);
  }

  /** Hide what is drawn about the robots for whoever looks at the room. */
  private hide(): Object3D[] {
    const { members, surroundings } = this.app;
    const drawn = members.flatMap((m) => m.place.children.filter((o) => o !== m.robot?.root));
    const hidden = [...drawn, ...surroundings.signs].filter((o) => o.visible);
    for (const thing of hidden) thing.visible = false;
    return hidden;
  }

  private fit(view: View): PerspectiveCamera {
    const { world } = this.app;
    const camera = view === 'scope' ? this.scope : world.camera;
    const b = this.box(view);
    const [right, bottom] = world.free();
    const large = view === this.large;
    camera.aspect = b.width / b.height;
    const [x, y] = large ? [(b.width - right) / 2, (b.height - bottom) / 2] : [0, 0];
    camera.setViewOffset(b.width, b.height, x, y, b.width, b.height);
    if (view === 'scope') this.scope.updateWorldMatrix(true, false);
    return camera;
  }
}
