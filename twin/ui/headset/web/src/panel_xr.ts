/** The controls in the headset: a panel in the room that is pressed by a ray, a pinch or gaze. */

import {
  CanvasTexture,
  Group,
  LinearFilter,
  Mesh,
  MeshBasicMaterial,
  Object3D,
  PlaneGeometry,
  SRGBColorSpace,
  Vector2,
  Vector3,
} from 'three';
import type { Button, Choice, Control, Drawer, Sheet, Slider } from './controls';
import { colorsOf, Pen } from './pen';
import type { Look } from './world';

const WIDTH = 1024; // pixels
const HEIGHT = 1000;
const WIDE = 0.48; // m
const PAD = 24;
const FOOT = 210; // minimum height of the controls at the bottom, in pixels
const REDRAW = 90; // minimum time in ms between two pictures

interface Zone {
  id: string;
  x: number;
  y: number;
  w: number;
  h: number;
  press?: () => void;
  slider?: Slider;
}

export class XrPanel implements Drawer {
  readonly group = new Group();
  readonly mesh: Mesh;
  look: Look = 'normal';

  private readonly canvas = document.createElement('canvas');
  private readonly texture: CanvasTexture;
  private readonly pen: Pen;
  private sheet: Sheet | null = null;
  private open = 'simulation';
  private zones: Zone[] = [];
  private hot = '';
  private held: Slider | null = null;
  private scroll = 0;
  private deepest = 0;
  private foot = FOOT;
  private drawn = 0;
  private stale = true;

  constructor() {
    this.canvas.width = WIDTH;
    this.canvas.height = HEIGHT;
    this.pen = new Pen(this.canvas);
    this.texture = new CanvasTexture(this.canvas);
    this.texture.colorSpace = SRGBColorSpace;
    this.texture.generateMipmaps = false;
    this.texture.minFilter = LinearFilter;
    const material = new MeshBasicMaterial({ map: this.texture, transparent: true, toneMapped: false });
    this.mesh = new Mesh(new PlaneGeometry(WIDE, (WIDE * HEIGHT) / WIDTH), material);
    this.mesh.userData['twinPanel'] = true;
    this.mesh.renderOrder = 8;
    this.group.add(this.mesh);
    this.group.visible = false;
  }

  show(sheet: Sheet): void {
    this.sheet = sheet;
    if (!sheet.tabs.some((tab) => tab.id === this.open)) this.open = sheet.tabs[0]?.id ?? '';
    this.stale = true;
  }

  refresh(): void {
    this.stale = true;
  }

  /** Place the panel left of the view direction, within reach, facing the viewer. */
  placeBefore(viewer: Vector3, forward: Vector3, aside = 0.36): void {
    const ahead = forward.clone().setY(0);
    if (ahead.lengthSq() < 1e-6) ahead.set(0, 0, -1);
    ahead.normalize();
    const left = new Vector3(ahead.z, 0, -ahead.x);
    this.group.position
      .copy(viewer)
      .addScaledVector(ahead, 0.72)
      .addScaledVector(left, aside)
      .add(new Vector3(0, -0.14, 0));
    this.group.lookAt(viewer);
  }

  /** Whether the panel is out of view: more than 2.2 m away, or more than 78 degrees from the view direction. */
  outOfSight(viewer: Vector3, forward: Vector3): boolean {
    const to = this.group.position.clone().sub(viewer);
    return to.length() > 2.2 || to.normalize().dot(forward) < 0.2;
  }

  /** Return the identifier of the control at a point (0..1 from the lower left), and highlight it. */
  hover(uv: Vector2 | null): string {
    const id = uv ? (this.zoneAt(uv)?.id ?? '') : '';
    if (id !== this.hot) {
      this.hot = id;
      this.stale = true;
    }
    return id;
  }

  press(uv: Vector2): boolean {
    const zone = this.zoneAt(uv);
    if (!zone) return false;
    if (zone.slider) {
      this.held = zone.slider;
      zone.slider.begin?.();
      this.slide(zone, uv);
    } else zone.press?.();
    this.stale = true;
    return true;
  }

  drag(uv: Vector2): void {
    const zone = this.zones.find((z) => z.slider === this.held);
    if (this.held && zone) this.slide(zone, uv);
  }

  release(): void {
    this.held?.end?.();
    this.held = null;
    this.stale = true;
  }

  /** Return the middle (0..1) of a control; null if it is not visible. For tests. */
  whereIs(id: string): Vector2 | null {
    const z = this.zones.find((zone) => zone.id === id);
    return z ? new Vector2((z.x + z.w / 2) / WIDTH, 1 - (z.y + z.h / 2) / HEIGHT) : null;
  }

  /** Return the point of the scene at a point (0..1) of the panel. */
  pointAt(uv: Vector2): Vector3 {
    const p = new Vector3((uv.x - 0.5) * WIDE, ((uv.y - 0.5) * WIDE * HEIGHT) / WIDTH, 0);
    return this.mesh.localToWorld(p);
  }

  /** Draw again after a change, at most once per `REDRAW`. */
  update(now: number): boolean {
    if (!this.group.visible || !this.stale || now - this.drawn < REDRAW || !this.sheet) return false;
    this.drawn = now;
    this.stale = false;
    this.draw(this.sheet);
    this.texture.needsUpdate = true;
    return true;
  }

  get object(): Object3D {
    return this.mesh;
  }

  private zoneAt(uv: Vector2): Zone | undefined {
    const [x, y] = [uv.x * WIDTH, (1 - uv.y) * HEIGHT];
    return this.zones.find((z) => x >= z.x && x <= z.x + z.w && y >= z.y && y <= z.y + z.h);
  }

  private slide(zone: Zone, uv: Vector2): void {
    const slider = zone.slider;
    if (!slider || slider.off?.()) return;
    const [low, high] = slider.range();
    const part = Math.min(1, Math.max(0, (uv.x * WIDTH - zone.x - 14) / (zone.w - 28)));
    slider.set(low + part * (high - low));
    this.stale = true;
  }

  private draw(sheet: Sheet): void {
    const pen = this.pen;
    pen.begin(colorsOf(this.look));
    this.zones = [];
    const inner = WIDTH - 2 * PAD;
    const n = sheet.tabs.length;
    const wide = (inner - 8 * (n - 1)) / n;
    sheet.tabs.forEach((tab, i) => {
      const x = PAD + i * (wide + 8);
      const zone = { id: `tab-${tab.id}`, x, y: PAD, w: wide, h: 62, press: () => this.choose(tab.id) };
      pen.button(zone, tab.label, tab.id === this.open, false, this.hot === zone.id);
      this.zones.push(zone);
    });
    const status = sheet.status;
    pen.text(status.text(), PAD, PAD + 78, inner, status.tone?.() ?? 'plain', 30, 2);
    const top = PAD + 168;
    const bottom = HEIGHT - PAD - this.foot;
    pen.rule(top - 10);
    const tab = sheet.tabs.find((t) => t.id === this.open);
    pen.clip(0, top, WIDTH, bottom - top);
    let y = top + 6 - this.scroll;
    for (const c of tab?.controls ?? []) y = this.control(c, PAD, y, inner - 70, top, bottom);
    pen.unclip();
    this.deepest = Math.max(0, y + this.scroll - bottom);
    this.scrollers(top, bottom);
    pen.rule(bottom + 8);
    y = bottom + 18;
    for (const c of sheet.transport) y = this.control(c, PAD, y, inner, 0, HEIGHT);
    // The height of texts is known after they are drawn.
    const foot = Math.max(FOOT, y - bottom);
    if (foot !== this.foot) {
      this.foot = foot;
      this.stale = true;
    }
  }

  /** Open a tab. */
  choose(id: string): void {
    this.open = id;
    this.scroll = 0;
    this.stale = true;
  }

  private scrollers(top: number, bottom: number): void {
    this.scroll = Math.min(this.scroll, this.deepest);
    if (this.deepest <= 0) return;
    const by = 0.7 * (bottom - top);
    const x = WIDTH - PAD - 56;
    const up: Zone = {
      id: 'scroll-up',
      x,
      y: top,
      w: 56,
      h: 120,
      press: () => (this.scroll = Math.max(0, this.scroll - by)),
    };
    const down: Zone = {
      id: 'scroll-down',
      x,
      y: bottom - 120,
      w: 56,
      h: 120,
      press: () => (this.scroll = Math.min(this.deepest, this.scroll + by)),
    };
    this.pen.button(up, '▲', false, this.scroll <= 0, this.hot === up.id);
    this.pen.button(down, '▼', false, this.scroll >= this.deepest, this.hot === down.id);
    this.zones.unshift(up, down);
  }

  /** Draw a control and return the y of the next one; only controls whose middle is between top and bottom are active. */
  private control(c: Control, x: number, y: number, w: number, top: number, bottom: number): number {
    const pen = this.pen;
    const zone = (z: Zone): Zone => {
      if (z.y + z.h / 2 >= top && z.y + z.h / 2 <= bottom) this.zones.push(z);
      return z;
    };
    switch (c.kind) {
      case 'head':
        if (c.shown?.() === false) return y;
        return pen.text(c.text, x, y + 10, w, 'plain', 30, 1, true) + 6;
      case 'text':
        return c.text() ? pen.text(c.text(), x, y, w, c.tone?.() ?? 'plain', 27, 400) + 12 : y;
      case 'button':
        return this.row([c], x, y, w, zone);
      case 'row':
        return c.shown?.() === false ? y : this.row(c.items, x, y, w, zone);
      case 'choice':
        return this.choice(c, x, y, w, zone);
      case 'slider':
        return this.slider(c, x, y, w, zone);
    }
  }

  private row(items: Button[], x: number, y: number, w: number, zone: (z: Zone) => Zone): number {
    const per = items.length > 3 && w < 950 ? 3 : items.length;
    const wide = (w - 8 * (per - 1)) / per;
    items.forEach((b, i) => {
      const at = { id: b.id, x: x + (i % per) * (wide + 8), y: y + Math.floor(i / per) * 68, w: wide, h: 60 };
      const off = b.off?.() ?? false;
      zone(off ? at : { ...at, press: b.press });
      this.pen.button(at, b.label(), b.on?.() ?? false, off, this.hot === b.id);
    });
    return y + Math.ceil(items.length / per) * 68 + 8;
  }

  /** Draw a choice with buttons for the next and previous option; drop-down lists are hard to use with a ray. */
  private choice(c: Choice, x: number, y: number, w: number, zone: (z: Zone) => Zone): number {
    const options = c.options();
    const i = Math.max(
      0,
      options.findIndex(([value]) => value === c.get()),
    );
    const go = (by: number) => () => c.set(options[(i + by + options.length) % options.length]?.[0] ?? '');
    this.pen.text(c.label, x, y, w, 'faint', 25, 1);
    const left = zone({ id: `${c.id}-previous`, x, y: y + 34, w: 72, h: 60, press: go(-1) });
    const right = zone({ id: `${c.id}-next`, x: x + w - 72, y: y + 34, w: 72, h: 60, press: go(1) });
    this.pen.button(left, '‹', false, options.length < 2, this.hot === left.id);
    this.pen.button(right, '›', false, options.length < 2, this.hot === right.id);
    this.pen.field({ x: x + 80, y: y + 34, w: w - 160, h: 60 }, options[i]?.[1] ?? '–');
    return y + 108;
  }

  private slider(c: Slider, x: number, y: number, w: number, zone: (z: Zone) => Zone): number {
    const [low, high] = c.range();
    const part = (v: number) => Math.min(1, Math.max(0, (v - low) / Math.max(high - low, 1e-9)));
    const value = c.get();
    let at = y;
    const spans = (c.segments?.() ?? []).map(([n, a, b]) => [n, part(a), part(b)] as const);
    if (spans.length) {
      this.pen.segments(x + 14, y, w - 28, 34, spans, part(value));
      at += 38;
    } else {
      this.pen.text(c.label, x, y, w / 2, 'plain', 27, 1);
    }
    const off = c.off?.() ?? false;
    if (!spans.length) {
      this.pen.right(c.show(value), x + w, y, 27);
      at += 34;
    }
    const z = { id: c.id, x, y: at, w, h: 52 };
    zone(off ? z : { ...z, slider: c });
    this.pen.bar(z, part(value), off, this.hot === c.id || this.held === c);
    if (spans.length) this.pen.right(c.show(value), x + w, at + 46, 25);
    return at + 60;
  }
}
