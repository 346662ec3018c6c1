/** Scene, camera, light, floor, and two looks: normal, and bright for additive displays. */

import {
  AmbientLight,
  BufferGeometry,
  CircleGeometry,
  Color,
  DirectionalLight,
  Float32BufferAttribute,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  NeutralToneMapping,
  Object3D,
  PerspectiveCamera,
  PCFShadowMap,
  Scene,
  ShadowMaterial,
  SRGBColorSpace,
  Vector2,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { Pace } from './pace';
import { Reflections } from './reflections';

export type Look = 'normal' | 'additive';

/** Colours of background, floor and lines of the grid (every fifth, others) by the theme of the page. */
const THEMES = {
  light: { sky: 0xe9eef5, disc: 0xf4f7fa, strong: 0xb9c4d1, faint: 0xd7dee7, shadow: 0.2 },
  dark: { sky: 0x161c23, disc: 0x1f2831, strong: 0x465464, faint: 0x303b47, shadow: 0.5 },
} as const;

type Theme = keyof typeof THEMES;

const HALF = 30; // half width of the grid in lines

/** Layer of the room's lamps: they light only the pictures of cameras on this layer. */
export const ROOM_LIGHT = 3;

/** Direction from the robot to the first camera position. */
export const VIEW: Readonly<Vector3> = new Vector3(0.62, 0.36, 0.8).normalize();

export class World {
  readonly renderer: WebGLRenderer;
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(40, 1, 0.01, 60);
  readonly orbit: OrbitControls;
  /** Node of the robot's place in the room: position, rotation about y, scale; the origin is on the floor below. */
  readonly placement = new Group();
  /** World node (z up), below `placement`. */
  readonly robotWorld = new Group();
  readonly floor = new Group();
  /** Quality of the pictures on a screen. */
  readonly pace: Pace;
  /** Time in ms of the last motion of an object or of the room's camera. */
  moved = -Infinity;
  look: Look = 'normal';
  /** Background colour, except in AR. */
  readonly sky = new Color();
  /** Whether a new picture is needed. */
  dirty = true;
  /** Size of the robot's bounding box in m. */
  size = 1;

  private covered = { left: 0, right: 0, bottom: 0, top: 0 };
  private framed: { middle: Vector3; radius: number; from: Vector3 } | null = null;
  private readonly sun = new DirectionalLight(0xffffff, 2.1);
  private readonly fill = new DirectionalLight(0xdfe9ff, 0.7);
  private readonly hemisphere = new HemisphereLight(0xffffff, 0xc9c4bc, 1.15);
  private readonly ambient = new AmbientLight(0xffffff, 0.15);
  private readonly shadow = new Mesh(new CircleGeometry(6, 48), new ShadowMaterial({ opacity: 0.2 }));
  private readonly grid = gridOf();
  private readonly disc = new Mesh(new CircleGeometry(4, 64), new MeshBasicMaterial({ toneMapped: false }));
  private readonly darkness = window.matchMedia('(prefers-color-scheme: dark)');
  readonly reflections: Reflections;
  private seeThrough = false;

  constructor(canvas: HTMLCanvasElement) {
    const processor = accelerated();
    this.renderer = new WebGLRenderer({ canvas, antialias: processor, alpha: true, powerPreference: 'high-performance' });
    this.pace = new Pace(this.renderer, !processor);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.0;
    this.renderer.xr.enabled = true;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    for (const lamp of [this.sun, this.fill, this.hemisphere, this.ambient]) lamp.layers.set(ROOM_LIGHT);
    this.camera.layers.enable(ROOM_LIGHT);
    this.robotWorld.rotation.x = -Math.PI / 2;
    this.placement.add(this.robotWorld);
    this.scene.add(this.placement, this.floor, this.sun, this.sun.target, this.fill, this.hemisphere, this.ambient);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.bias = -0.0004;
    this.sun.shadow.normalBias = 0.004;
    this.sun.shadow.radius = 4;
    this.shadow.rotation.x = -Math.PI / 2;
    this.shadow.receiveShadow = true;
    this.shadow.position.y = 0.0005;
    this.disc.rotation.x = -Math.PI / 2;
    this.disc.position.y = -0.002;
    this.floor.add(this.disc, this.grid, this.shadow);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.enableDamping = false;
    this.orbit.addEventListener('change', () => {
      this.moved = performance.now();
      this.dirty = true;
    });
    this.reflections = new Reflections(this.renderer, this.scene, this.hemisphere);
    this.setLook('normal', false);
    this.darkness.addEventListener('change', () => this.setLook(this.look, this.seeThrough));
    window.addEventListener('resize', () => this.resize());
    this.resize();
  }

  resize(): void {
    if (this.renderer.xr.isPresenting) return;
    const canvas = this.renderer.domElement;
    const [w, h] = [canvas.clientWidth || 1, canvas.clientHeight || 1];
    const canvasSize = this.renderer.getSize(new Vector2());
    if (canvasSize.x !== w || canvasSize.y !== h) {
      this.renderer.setSize(w, h, false); // this clears the canvas
      this.pace.forget();
    }
    // The middle of the picture is the middle of the area without controls.
    const { left, right, bottom, top } = this.covered;
    this.camera.setViewOffset(w, h, (right - left) / 2, (bottom - top) / 2, w, h);
    this.dirty = true;
  }

  /** Set the size in pixels that the controls cover at all sides; return whether it has changed. */
  cover(left: number, right: number, bottom: number, top: number): boolean {
    const { covered } = this;
    if (left === covered.left && right === covered.right && bottom === covered.bottom && top === covered.top) return false;
    this.covered = { left, right, bottom, top };
    this.resize();
    return true;
  }

  /** Return the drawn parts of the floor; they never move. */
  get ground(): readonly (Mesh | LineSegments)[] {
    return [this.disc, this.grid, this.shadow];
  }

  /** Width in pixels that the controls cover at the left. */
  get beside(): number {
    return this.covered.left;
  }

  /** Width and height in pixels of the area without controls at the right and the bottom, from the upper left. */
  free(): [right: number, bottom: number] {
    const { clientWidth: w, clientHeight: h } = this.renderer.domElement;
    return [w - this.covered.right, h - this.covered.bottom];
  }

  /** Set the camera to the front right of the robot, so that the robot's box fills the picture. */
  frameAll(middle: Vector3, radius: number): void {
    const { clientWidth: w, clientHeight: h } = this.renderer.domElement;
    const { left, right, bottom, top } = this.covered;
    const free = Math.max(0.2, Math.min((h - bottom - top) / h, (w - left - right) / h));
    const away = (0.9 * radius) / Math.sin(Math.atan(Math.tan((this.camera.fov * Math.PI) / 360) * free));
    this.camera.position.copy(middle).addScaledVector(VIEW, away);
    this.camera.near = Math.max(0.002, away / 200);
    this.camera.far = 60 * Math.max(1, away);
    this.camera.updateProjectionMatrix();
    this.orbit.target.copy(middle);
    this.orbit.minDistance = 0.05 * radius;
    this.orbit.maxDistance = 12 * radius;
    this.orbit.update();
    this.framed = { middle: middle.clone(), radius, from: this.camera.position.clone() };
    this.dirty = true;
  }

  /** Fill the picture again after the controls have changed their size, if nobody has moved the camera. */
  frameAgain(): void {
    const { framed, camera, renderer } = this;
    if (framed && !renderer.xr.isPresenting && camera.position.equals(framed.from)) this.frameAll(framed.middle, framed.radius);
  }

  /** Adapt light and shadow to the robot at `placement`. */
  relight(): void {
    const s = this.size * this.placement.scale.x;
    const at = this.placement.position;
    this.sun.position.set(at.x + 0.9 * s, at.y + 2.6 * s, at.z + 1.3 * s);
    this.sun.target.position.set(at.x, at.y + 0.35 * s, at.z);
    this.fill.position.set(at.x - 2 * s, at.y + s, at.z - 1.5 * s);
    const c = this.sun.shadow.camera;
    c.left = c.bottom = -1.3 * s;
    c.right = c.top = 1.3 * s;
    c.near = 0.2 * s;
    c.far = 6 * s;
    c.updateProjectionMatrix();
    this.sun.shadow.normalBias = 0.006 * s;
    this.shadow.position.set(at.x, at.y + 0.0005, at.z);
    this.shadow.scale.setScalar(Math.max(0.2, 0.5 * s));
    const cell = 0.1 * 10 ** Math.round(Math.log10(Math.max(s, 1e-3)));
    this.grid.scale.setScalar(cell / 0.1);
    this.disc.scale.setScalar(cell / 0.1);
    this.touch();
  }

  /** Request a new picture with new shadows, because the robot has moved. */
  touch(): void {
    this.dirty = true;
    this.renderer.shadowMap.needsUpdate = true;
  }

  /** Whether the page, and with it the background of the picture, is dark. */
  private get theme(): Theme {
    return this.darkness.matches ? 'dark' : 'light';
  }

  /** Light the robots by a room that shiny parts reflect (true), or by lamps alone. */
  reflect(on: boolean): void {
    this.reflections.show(on);
    this.touch();
  }

  setLook(look: Look, seeThrough: boolean): void {
    this.look = look;
    this.seeThrough = seeThrough;
    const additive = look === 'additive';
    const colors = THEMES[this.theme];
    // Black is transparent on an additive display; on a screen, a dark background previews such a display.
    this.sky.set(additive ? 0x000000 : colors.sky);
    (this.disc.material as MeshBasicMaterial).color.set(colors.disc);
    (this.shadow.material as ShadowMaterial).opacity = colors.shadow;
    tintGrid(this.grid.geometry, this.theme);
    this.scene.background = seeThrough ? null : this.sky;
    this.ambient.intensity = additive ? 0.5 : 0.15;
    this.sun.castShadow = !additive;
    this.shadow.visible = !additive;
    this.disc.visible = !seeThrough && !additive;
    this.grid.visible = !seeThrough;
    const lines = this.grid.material as LineBasicMaterial;
    lines.opacity = additive ? 0.35 : 1;
    lines.transparent = additive;
    lines.needsUpdate = true;
    this.touch();
  }
}

/** Whether a graphics processor draws. If software draws, antialiasing is off, because it doubles the time of a picture. */
function accelerated(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2');
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}

/** Return a grid of lines 10 cm apart, without colours. */
function gridOf(): LineSegments {
  const positions: number[] = [];
  const add = (x: number, z: number) => positions.push(0.1 * x, 0, 0.1 * z);
  for (let i = -HALF; i <= HALF; i++)
    for (let k = -HALF; k < HALF; k++) {
      if (Math.hypot(i, k + 0.5) > HALF) continue;
      (add(i, k), add(i, k + 1));
      (add(k, i), add(k + 1, i));
    }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new Float32BufferAttribute(positions, 3));
  geometry.setAttribute('color', new Float32BufferAttribute(positions.length, 3));
  const material = new LineBasicMaterial({ vertexColors: true, toneMapped: false });
  return new LineSegments(geometry, material);
}

/** Colour the lines of a grid: every fifth is stronger, and all fade to the background towards the rim. */
function tintGrid(grid: BufferGeometry, theme: Theme): void {
  const colors = THEMES[theme];
  const [strong, faint, rim] = [new Color(colors.strong), new Color(colors.faint), new Color(colors.sky)];
  const at = grid.getAttribute('position');
  const tints = grid.getAttribute('color');
  const tint = new Color();
  for (let i = 0; i < at.count; i++) {
    const [x, z] = [Math.round(10 * at.getX(i)), Math.round(10 * at.getZ(i))];
    // both ends of a line from one crossing to the next have the coordinate that the line keeps
    const other = i % 2 ? i - 1 : i + 1;
    const kept = Math.round(10 * at.getX(other)) === x ? x : z;
    const fade = Math.min(1, Math.hypot(x, z) / HALF) ** 1.5;
    tint.copy(kept % 5 === 0 ? strong : faint).lerp(rim, fade);
    tints.setXYZ(i, tint.r, tint.g, tint.b);
  }
  tints.needsUpdate = true;
}

/** Remove an object, and release its memory on the GPU. */
export function discard(object: Object3D): void {
  object.removeFromParent();
  object.traverse((o) => {
    const m = o as Partial<Mesh>;
    m.geometry?.dispose();
    for (const material of [m.material ?? []].flat()) material.dispose();
  });
}
