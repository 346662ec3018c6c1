/** The console's screen in a headset: a plane in the room that shows each eye the picture of its lens. */

import {
  Group,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Quaternion,
  Vector3,
  WebGLRenderTarget,
} from 'three';
import type { App } from './app';
import { EYES, type Eye } from './eyes';
import type { Views } from './views';

const WIDE = 1; // m
const HIGH = 0.62;
const AWAY = 1.15; // m from the viewer
const PART = 0.3; // width of the small picture as a fraction of the screen's width
const SMALLER = 0.45; // size factor while the room is the large view
const HIGHER = 0.42; // m: additional height in that case, so that the screen is above the patient
const REST = 250; // ms between two updates of the small picture
const LONG_REST = 5000; // ms between two updates of the small picture on a slow device
const SLOW = 50; // ms between two pictures above which a device counts as slow
const SHARPEST = 1280; // maximum width in pixels
const LAYER: Readonly<Record<Eye, number>> = { left: 1, right: 2 };

export class Screen {
  readonly group = new Group();
  private readonly panes: Readonly<Record<Eye, Mesh<PlaneGeometry, MeshBasicMaterial>>>;
  private readonly small: Mesh<PlaneGeometry, MeshBasicMaterial>;
  private readonly room = new WebGLRenderTarget(480, Math.round((480 * HIGH) / WIDE), { samples: 4 });
  private drawn = -Infinity;
  private height = 0;
  private last = 0;

  constructor(
    private readonly app: App,
    private readonly views: Views,
  ) {
    const pane = () => new Mesh(new PlaneGeometry(WIDE, HIGH), new MeshBasicMaterial());
    this.panes = { left: pane(), right: pane() };
    for (const eye of EYES) this.panes[eye].layers.set(LAYER[eye]);
    this.small = pane();
    this.small.scale.setScalar(PART);
    this.small.position.set(-WIDE * (0.5 - PART / 2) + 0.01, -HIGH * (0.5 - PART / 2) + 0.01, 0.004);
    this.small.material.map = this.room.texture;
    const edge = new Mesh(new PlaneGeometry(WIDE + 0.016, HIGH + 0.016), new MeshBasicMaterial({ color: 0x2a3340 }));
    edge.position.z = -0.003;
    this.group.add(edge, this.panes.left, this.panes.right, this.small);
    this.group.visible = false;
    app.world.scene.add(this.group);
  }

  /** Attitude in the room. */
  turned(out: Quaternion): Quaternion {
    return this.group.getWorldQuaternion(out);
  }

  /** Place the screen upright in front of the viewer, slightly below the eyes. */
  placeBefore(viewer: Vector3, forward: Vector3): void {
    const ahead = forward.clone().setY(0);
    if (ahead.lengthSq() < 1e-6) ahead.set(0, 0, -1);
    this.group.position.copy(viewer).addScaledVector(ahead.normalize(), AWAY);
    this.height = this.group.position.y -= 0.08;
    this.group.lookAt(viewer.x, this.group.position.y, viewer.z);
    this.group.visible = true;
  }

  /** Hide the screen at the end of a session. */
  hide(): void {
    this.group.visible = false;
    this.app.world.placement.visible = true;
  }

  /** Update the pictures: of the lenses after every change, of the room periodically. */
  draw(now: number): void {
    const { world } = this.app;
    const scope = this.views.large === 'scope';
    const rest = now - this.last > SLOW ? LONG_REST : REST;
    this.last = now;
    this.group.scale.setScalar(scope ? 1 : SMALLER);
    this.group.position.y = this.height + (scope ? 0 : HIGHER);
    this.small.visible = scope;
    if (world.dirty) {
      const width = Math.round(Math.min(SHARPEST, Math.max(256, 0.6 * this.eyeWidth())));
      const height = Math.round((width * HIGH) / WIDE);
      const pictures = this.views.drawEyes(width, height);
      for (const eye of EYES) {
        const { material } = this.panes[eye];
        if (material.map !== pictures[eye].texture) {
          material.map = pictures[eye].texture;
          material.needsUpdate = true;
        }
      }
      if (scope && now - this.drawn > rest) {
        this.drawn = now;
        this.views.drawRoom(this.room);
      }
    }
    // While the endoscope's picture is large, robots and shadows are hidden, so that they do not cover it.
    if (world.placement.visible === scope) world.renderer.shadowMap.needsUpdate = true;
    world.placement.visible = !scope;
  }

  private eyeWidth(): number {
    return this.app.world.renderer.xr.getCamera().cameras[0]?.viewport?.z ?? SHARPEST;
  }
}
