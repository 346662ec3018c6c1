/** Hands and controllers in XR; without them, gaze with a dwell time. */

import {
  BufferGeometry,
  Group,
  Line,
  LineBasicMaterial,
  Matrix4,
  Mesh,
  Plane,
  Quaternion,
  Raycaster,
  RingGeometry,
  SphereGeometry,
  Vector2,
  Vector3,
} from 'three';
import type { XRGripSpace, XRHandSpace, XRTargetRaySpace } from 'three';
import type { App } from './app';
import { accentuate, BLUE, flat } from './ink';
import { pickNear, pickRay, rayOf } from './pick';

const SLOTS = 4; // maximum number of input sources
const DWELL = 1400; // ms of gaze at one target that count as a press
const STILL = 0.02; // motion of the gaze meanwhile, as a fraction of its distance (of 1 m, if the target is nearer)

type Doing = 'nothing' | 'panel' | 'grab' | 'move' | 'free';

class Hand {
  source: XRInputSource | null = null;
  doing: Doing = 'nothing';
  /** Pose of the hand, and grabbed point in the hand's frame, at the start of the grab. */
  first = new Matrix4();
  local = new Vector3();
  near = false;
  pointsAtPanel = false;
  last = new Vector3();
  readonly beam: Line;
  readonly dot: Mesh;

  constructor(
    readonly ray: XRTargetRaySpace,
    readonly grip: XRGripSpace,
    readonly hand: XRHandSpace,
  ) {
    this.beam = new Line(
      new BufferGeometry().setFromPoints([new Vector3(), new Vector3(0, 0, -1)]),
      accentuate(new LineBasicMaterial({ transparent: true, opacity: 0.7, toneMapped: false })),
    );
    this.beam.visible = false;
    this.beam.frustumCulled = false;
    ray.add(this.beam);
    this.dot = new Mesh(new SphereGeometry(0.006, 12, 8), accentuate(flat(BLUE)));
    this.dot.visible = false;
  }

  /** Midpoint between the tips of thumb and index finger; null for a controller. */
  pinch(): Vector3 | null {
    const joints = this.hand.joints as Partial<XRHandSpace['joints']> | undefined;
    const [a, b] = [joints?.['index-finger-tip'], joints?.['thumb-tip']];
    if (!this.source?.hand || !a?.visible || !b) return null;
    return a.getWorldPosition(new Vector3()).add(b.getWorldPosition(new Vector3())).multiplyScalar(0.5);
  }

  /** Pose that the held part follows: of the hand if it touches the part, of the ray if it points at it. */
  pose(): Matrix4 {
    if (!this.near) return this.ray.matrixWorld;
    const p = this.pinch();
    const T = this.grip.matrixWorld.clone();
    return p ? T.setPosition(p) : T;
  }
}

export class Hands {
  private readonly hands: Hand[] = [];
  private readonly caster = new Raycaster();
  private two = false;
  private readonly gaze = new Group();
  private readonly cursor: Mesh;
  private readonly gazeHand: Hand;
  private dwell = { id: '', at: new Vector3(), since: 0, done: false };

  constructor(private readonly app: App) {
    const { renderer, scene } = app.world;
    for (let i = 0; i < SLOTS; i++) {
      const hand = new Hand(renderer.xr.getController(i), renderer.xr.getControllerGrip(i), renderer.xr.getHand(i));
      scene.add(hand.ray, hand.grip, hand.hand, hand.dot);
      this.listen(hand);
      this.hands.push(hand);
    }
    this.gazeHand = new Hand(
      this.gaze as XRTargetRaySpace,
      this.gaze as unknown as XRGripSpace,
      new Group() as XRHandSpace,
    );
    scene.add(this.gaze);
    this.cursor = new Mesh(new RingGeometry(0.006, 0.011, 24, 1, 0, 2 * Math.PI), accentuate(flat(BLUE)));
    this.cursor.visible = false;
    this.cursor.renderOrder = 12;
    (this.cursor.material as ReturnType<typeof flat>).depthTest = false;
    scene.add(this.cursor);
  }

  /** Number of input sources. */
  get count(): number {
    return this.hands.filter((h) => h.source).length;
  }

  /** Pointing input sources, right hand first. */
  get pointing(): XRInputSource[] {
    const all = this.hands.flatMap((h) => (h.source?.targetRayMode === 'tracked-pointer' ? [h.source] : []));
    return all.sort((a, b) => Number(b.handedness === 'right') - Number(a.handedness === 'right'));
  }

  /** Whether a hand points at the panel, or presses a control on it. */
  usesPanel(side: XRHandedness): boolean {
    return this.hands.some((h) => h.source?.handedness === side && (h.doing === 'panel' || h.pointsAtPanel));
  }

  update(now: number): void {
    if (!this.app.xr.presenting) return;
    for (const hand of this.hands) if (hand.source) this.follow(hand);
    this.pair();
    this.look(now);
  }

  /** Release everything at the end of a session. */
  forget(): void {
    for (const hand of [...this.hands, this.gazeHand]) {
      this.stop(hand);
      hand.beam.visible = hand.dot.visible = false;
    }
    this.cursor.visible = false;
  }

  private listen(hand: Hand): void {
    hand.ray.addEventListener('connected', (event) => {
      hand.source = event.data;
      const points = hand.source.targetRayMode === 'tracked-pointer';
      hand.beam.visible = points;
      this.app.refresh();
    });
    hand.ray.addEventListener('disconnected', () => {
      this.stop(hand);
      hand.source = null;
      hand.beam.visible = hand.dot.visible = false;
      this.app.refresh();
    });
    hand.ray.addEventListener('selectstart', () => this.start(hand));
    hand.ray.addEventListener('selectend', () => this.stop(hand));
    hand.ray.addEventListener('squeezestart', () => {
      if (hand.doing === 'nothing' && !this.app.console) this.begin(hand, 'move');
    });
    hand.ray.addEventListener('squeezeend', () => {
      if (hand.doing === 'move') this.stop(hand);
    });
  }

  private start(hand: Hand): void {
    const { app } = this;
    if (hand.doing !== 'nothing') return;
    const caster = rayOf(hand.ray.matrixWorld, this.caster);
    const panel = caster.intersectObject(app.xrPanel.mesh, false)[0];
    if (panel?.uv && app.xrPanel.group.visible) {
      hand.doing = 'panel';
      app.xrPanel.press(panel.uv);
      return;
    }
    if (app.console) return; // at a console, hands control instruments, not links
    if (app.place.placing && app.place.reticle.visible) {
      app.place.putAt(new Vector3().setFromMatrixPosition(app.place.reticle.matrix), app.xr.viewer());
      return;
    }
    const tip = hand.pinch();
    const touched = tip ? pickNear(tip, app.members) : null;
    const hit = touched ?? pickRay(caster, app.members);
    if (app.place.moving || !hit) return this.begin(hand, app.place.moving ? 'move' : 'free');
    if (!app.take(hit)) return;
    hand.doing = 'grab';
    hand.near = touched !== null;
    hand.first.copy(hand.pose());
    hand.local.copy(hit.point).applyMatrix4(hand.first.clone().invert());
  }

  private begin(hand: Hand, how: 'move' | 'free'): void {
    hand.doing = how;
    hand.last.copy(this.where(hand));
  }

  private stop(hand: Hand): void {
    if (hand.doing === 'panel') this.app.xrPanel.release();
    if (hand.doing === 'grab') this.app.grab.end();
    hand.doing = 'nothing';
    hand.near = false;
  }

  private follow(hand: Hand): void {
    const { app } = this;
    const caster = rayOf(hand.ray.matrixWorld, this.caster);
    const panel = app.xrPanel.group.visible ? caster.intersectObject(app.xrPanel.mesh, false)[0] : undefined;
    hand.pointsAtPanel = panel !== undefined;
    if (hand.doing === 'nothing') app.xrPanel.hover(panel?.uv ?? null);
    if (hand.doing === 'panel') {
      const uv = this.onPanel(caster);
      if (uv) app.xrPanel.drag(uv);
    }
    if (hand.doing === 'grab') this.drag(hand);
    if (hand.doing === 'move' && !this.two) {
      const at = this.where(hand);
      app.place.shift(at.clone().sub(hand.last));
      hand.last.copy(at);
    }
    this.drawBeam(hand, panel?.distance);
    const side = hand.source?.handedness;
    const leads = (side === 'left' || side === 'right') && app.console?.hands.leading.has(side);
    hand.beam.visible = hand.source?.targetRayMode === 'tracked-pointer' && (!leads || panel !== undefined);
  }

  private drag(hand: Hand): void {
    const T = hand.pose();
    const point = hand.local.clone().applyMatrix4(T);
    const now = new Quaternion().setFromRotationMatrix(T);
    const then = new Quaternion().setFromRotationMatrix(hand.first);
    this.app.grab.move(point, this.app.grab.turning ? now.multiply(then.invert()) : new Quaternion());
  }

  /** Two hands that hold no link turn and scale the whole robot. */
  private pair(): void {
    const { place } = this.app;
    const [a, b] = this.hands.filter((h) => h.doing === 'free' || h.doing === 'move');
    if (!a || !b) {
      if (this.two) {
        place.endTwo();
        for (const h of this.hands) h.last.copy(this.where(h));
      }
      this.two = false;
      return;
    }
    if (!this.two) place.beginTwo(this.where(a), this.where(b));
    else place.moveTwo(this.where(a), this.where(b));
    this.two = true;
  }

  private where(hand: Hand): Vector3 {
    return hand.pinch() ?? new Vector3().setFromMatrixPosition(hand.ray.matrixWorld);
  }

  private onPanel(caster: Raycaster): Vector2 | null {
    const mesh = this.app.xrPanel.mesh;
    const normal = new Vector3(0, 0, 1).transformDirection(mesh.matrixWorld);
    const plane = new Plane().setFromNormalAndCoplanarPoint(normal, mesh.getWorldPosition(new Vector3()));
    const p = caster.ray.intersectPlane(plane, new Vector3());
    if (!p) return null;
    const { width, height } = (mesh.geometry as unknown as { parameters: { width: number; height: number } })
      .parameters;
    mesh.worldToLocal(p);
    return new Vector2(p.x / width + 0.5, p.y / height + 0.5);
  }

  private drawBeam(hand: Hand, panel: number | undefined): void {
    const tip = hand.pinch();
    hand.dot.visible = tip !== null;
    if (tip) hand.dot.position.copy(tip);
    const long = panel ?? (hand.doing === 'grab' && !hand.near ? hand.local.length() : 1.2);
    hand.beam.scale.z = long;
    (hand.beam.material as LineBasicMaterial).opacity = panel !== undefined || hand.doing !== 'nothing' ? 0.9 : 0.35;
  }

  // -- neither hands nor controllers --------------------------------------------------------------------

  /** Without buttons, gaze at one target for `DWELL` is a press; gaze at a held link for `DWELL` releases it. */
  private look(now: number): void {
    const { app } = this;
    const alone = this.count === 0;
    this.cursor.visible = alone;
    if (!alone) return;
    app.xr.head(this.gaze);
    const hand = this.gazeHand;
    const caster = rayOf(this.gaze.matrixWorld, this.caster);
    const panel = app.xrPanel.group.visible ? caster.intersectObject(app.xrPanel.mesh, false)[0] : undefined;
    const id = panel?.uv ? app.xrPanel.hover(panel.uv) : '';
    const robotHit = panel || app.console ? null : pickRay(caster, app.members);
    const aim = app.place.placing && app.place.reticle.visible && !panel;
    const target =
      id || (hand.doing === 'grab' ? 'holding' : aim ? 'floor' : robotHit ? `${robotHit.member.model.info?.name}/${robotHit.link ?? 'handle'}` : '');
    const at = panel?.point ?? robotHit?.point ?? caster.ray.at(1.5, new Vector3());
    if (hand.doing === 'grab') this.drag(hand);
    this.timeLook(now, target, at);
    this.drawCursor(at, now, target);
  }

  private timeLook(now: number, target: string, at: Vector3): void {
    const d = this.dwell;
    const hand = this.gazeHand;
    const wandered = at.distanceTo(d.at) > STILL * Math.max(1, at.distanceTo(this.app.xr.viewer()));
    if (target !== d.id || wandered) {
      this.dwell = { id: target, at: at.clone(), since: now, done: false };
      return;
    }
    if (!target || d.done || now - d.since < DWELL) return;
    d.done = true;
    if (hand.doing === 'grab') this.stop(hand);
    else {
      this.start(hand);
      if (!this.app.grab.held) this.stop(hand);
    }
  }

  private drawCursor(at: Vector3, now: number, target: string): void {
    const head = this.app.xr.viewer();
    this.cursor.position.copy(at).addScaledVector(head.clone().sub(at).normalize(), 0.01);
    this.cursor.lookAt(head);
    const full = target && !this.dwell.done ? Math.min(1, (now - this.dwell.since) / DWELL) : 0;
    this.cursor.scale.setScalar((1 + 0.9 * full) * Math.max(0.6, at.distanceTo(head)));
  }
}
