/** Sessions: AR or VR, or the reason why neither is available. */

import { Matrix4, Object3D, Quaternion, Vector3 } from 'three';
import type { App } from './app';

export type XrMode = 'immersive-ar' | 'immersive-vr';

const OPTIONAL = ['local-floor', 'hit-test', 'hand-tracking'];
const EYES = 1.4; // assumed height in m of the eyes above the floor, if the device does not measure the floor
const ASIDE = 0.68; // m to the left, so that the panel does not cover the console's screen
const AWAY = 1500; // ms out of view after which the panel is moved into view

export class Xr {
  ar = false;
  vr = false;
  /** Text on the AR and VR support of this browser. */
  text = 'Looking for a headset …';
  session: XRSession | null = null;
  mode: XrMode | null = null;
  blend = '';
  canPlace = false;
  /** Number of pictures drawn in this session. */
  frames = 0;

  private floor = 0;
  private viewerHits: XRHitTestSource | null = null;
  /** Hit-test source of each pointing input source; null while it is being requested. */
  private readonly pointerHits = new Map<XRInputSource, XRHitTestSource | null>();
  private settled = false;
  private awaySince = 0;
  private readonly position = new Vector3();
  private readonly quaternion = new Quaternion();
  private backdrop: 'normal' | 'additive' = 'normal';

  constructor(private readonly app: App) {}

  get presenting(): boolean {
    return this.session !== null;
  }

  /** Detect AR and VR support. */
  async detect(): Promise<void> {
    const xr = navigator.xr;
    if (!xr)
      this.text = window.isSecureContext
        ? 'This browser does not support WebXR. Use mouse or touch on this screen.'
        : 'A headset requires https: start twin serve with --cert and --key. Use mouse or touch on this screen.';
    else {
      const has = (mode: XrMode) => xr.isSessionSupported(mode).catch(() => false);
      [this.ar, this.vr] = await Promise.all([has('immersive-ar'), has('immersive-vr')]);
      this.text = this.ar
        ? 'AR is available: the robot is shown in your room.'
        : this.vr
          ? 'VR is available, AR is not: the robot is shown in an empty room.'
          : 'No headset found. Use mouse or touch on this screen, or open this address in the browser of a headset.';
      xr.ondevicechange = () => void this.detect();
    }
    this.app.refresh();
  }

  /** Enter a session; must be called from a press event. If AR fails, VR is tried. */
  async enter(mode: XrMode = this.ar ? 'immersive-ar' : 'immersive-vr'): Promise<void> {
    const xr = navigator.xr;
    if (!xr || this.session) return;
    const { renderer } = this.app.world;
    try {
      const session = await xr.requestSession(mode, { optionalFeatures: OPTIONAL });
      const floor = await session.requestReferenceSpace('local-floor').then(
        () => true,
        () => false,
      );
      renderer.xr.setReferenceSpaceType(floor ? 'local-floor' : 'local');
      this.floor = floor ? 0 : -EYES;
      session.addEventListener('end', () => this.ended());
      this.session = session;
      this.mode = mode;
      this.blend = session.environmentBlendMode ?? 'opaque';
      this.settled = false;
      this.frames = 0;
      await renderer.xr.setSession(session);
      this.begun();
    } catch (error) {
      this.session = null;
      if (mode === 'immersive-ar' && this.vr) {
        this.app.model.say('AR could not be started; trying VR.');
        await this.enter('immersive-vr');
      } else this.app.model.say(`The headset did not start the session: ${(error as Error).message}`);
    }
  }

  async leave(): Promise<void> {
    await this.session?.end();
  }

  /** Return the position of the head in the scene. */
  viewer(): Vector3 {
    return this.position;
  }

  /** Set the pose of an object to that of the head. */
  head(object: Object3D): void {
    object.position.copy(this.position);
    object.quaternion.copy(this.quaternion);
    object.updateMatrixWorld(true);
  }

  /** Update the session; called for each picture. */
  update(frame: XRFrame, now: number): void {
    const { app } = this;
    const space = app.world.renderer.xr.getReferenceSpace();
    const pose = space ? frame.getViewerPose(space) : undefined;
    if (!space || !pose) return;
    this.frames++;
    const { position, orientation } = pose.transform;
    this.position.set(position.x, position.y, position.z);
    this.quaternion.set(orientation.x, orientation.y, orientation.z, orientation.w);
    const forward = new Vector3(0, 0, -1).applyQuaternion(this.quaternion);
    if (!this.settled && app.robot) {
      this.settled = true;
      app.place.before(this.position, forward, this.floor);
      app.xrPanel.placeBefore(this.position, forward, app.console ? ASIDE : undefined);
      app.console?.screen.placeBefore(this.position, forward);
      if (this.canPlace && !app.console) app.place.begin();
    }
    app.console?.hands.update(frame, space, now);
    this.aim(frame, space);
    this.fetchPanel(forward, now);
  }

  private begun(): void {
    const { app } = this;
    const seeThrough = this.blend !== 'opaque';
    this.backdrop = app.world.look;
    app.xrPanel.group.visible = true;
    app.setLook(this.blend === 'additive' ? 'additive' : app.world.look, seeThrough);
    void this.prepareHits();
    app.refresh();
  }

  private async prepareHits(): Promise<void> {
    const session = this.session;
    if (!session?.requestHitTestSource || this.mode !== 'immersive-ar') return;
    if (session.enabledFeatures && !session.enabledFeatures.includes('hit-test')) return;
    try {
      const space = await session.requestReferenceSpace('viewer');
      this.viewerHits = (await session.requestHitTestSource({ space })) ?? null;
      this.canPlace = this.viewerHits !== null;
      if (this.canPlace && !this.app.console) this.app.place.begin();
    } catch {
      this.canPlace = false; // the device has no hit test: the robot stays in front of the viewer
    }
    this.app.refresh();
  }

  /** Show the reticle where a pointing hand, or else the gaze, hits a horizontal surface; hide it without a hit. */
  private aim(frame: XRFrame, space: XRReferenceSpace): void {
    const { place, hands } = this.app;
    if (!place.placing) return place.aim(null);
    const pointing = hands.pointing;
    for (const source of pointing) if (!this.pointerHits.has(source)) this.askHits(source);
    for (const source of [...pointing.map((p) => this.pointerHits.get(p)), this.viewerHits]) {
      if (!source) continue;
      for (const hit of frame.getHitTestResults(source)) {
        const pose = hit.getPose(space);
        if (!pose) continue;
        const T = new Matrix4().fromArray(pose.transform.matrix);
        if (new Vector3().setFromMatrixColumn(T, 1).y < 0.8) continue; // a wall
        return place.aim(new Matrix4().setPosition(new Vector3().setFromMatrixPosition(T)));
      }
    }
    place.aim(null);
  }

  private askHits(source: XRInputSource): void {
    this.pointerHits.set(source, null);
    void this.session?.requestHitTestSource?.({ space: source.targetRaySpace })?.then(
      (hits) => this.pointerHits.set(source, hits),
      () => undefined, // then only the gaze aims
    );
  }

  private fetchPanel(forward: Vector3, now: number): void {
    const { xrPanel } = this.app;
    if (!xrPanel.outOfSight(this.position, forward)) this.awaySince = now;
    else if (now - this.awaySince > AWAY) {
      xrPanel.placeBefore(this.position, forward, this.app.console ? ASIDE : undefined);
      this.awaySince = now;
    }
  }

  private ended(): void {
    const { app } = this;
    this.session = null;
    this.mode = null;
    this.viewerHits = null;
    this.pointerHits.clear();
    this.canPlace = false;
    app.hands.forget();
    app.console?.hands.forget();
    app.console?.screen.hide();
    app.place.placing = app.place.moving = false;
    app.place.aim(null);
    app.xrPanel.group.visible = false;
    app.place.reset();
    app.setLook(this.backdrop, false);
    app.world.resize();
    app.refresh();
  }
}
