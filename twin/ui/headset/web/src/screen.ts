/** The console's screen in a headset: it stands in the room, and shows each eye the picture of its lens. */

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
const PART = 0.3; // of the width, which the small picture takes
const SMALLER = 0.45; // of the size while the room is looked at
const HIGHER = 0.42; // m, likewise: above the patient
const REST = 250; // ms between two of the small picture
const LONG_REST = 5000; // ms of the same where pictures come slowly
const SLOW = 50; // ms between two pictures
const SHARPEST = 1280; // pixels
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

  /** Stand before a viewer, upright, a little below the eyes. */
  placeBefore(viewer: Vector3, forward: Vector3): void {
    const ahead = forward.clone().setY(0);
    if (ahead.lengthSq() < 1e-6) ahead.set(0, 0, -1);
    this.group.position.copy(viewer).addScaledVector(ahead.normalize(), AWAY);
    this.height = this.group.position.y -= 0.08;
    this.group.lookAt(viewer.x, this.group.position.y, viewer.z);
    this.group.visible = true;
  }

  /** The session has ended. */
  hide(): void {
    this.group.visible = false;
    this.app.world.placement.visible = true;
  }

  /** Bring the pictures up to date: those of the lenses with every change, that of the room now and then. */
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
    // With the endoscope's picture before one's eyes the robots do not stand in the way, nor do their shadows lie there.
    if (world.placement.visible === scope) world.renderer.shadowMap.needsUpdate = true;
    world.placement.visible = !scope;
  }

  private eyeWidth(): number {
    return this.app.world.renderer.xr.getCamera().cameras[0]?.viewport?.z ?? SHARPEST;
  }
}
