/**
 * Still surroundings in the picture of a camera at rest: drawn once, then copied below everything that can move.
 * They are not antialiased: the copy is only for slow graphics.
 */

import {
  AlwaysDepth,
  DepthTexture,
  type LineSegments,
  Mesh,
  NearestFilter,
  type Object3D,
  OrthographicCamera,
  type PerspectiveCamera,
  PlaneGeometry,
  ShaderMaterial,
  SRGBColorSpace,
  Vector2,
  WebGLRenderTarget,
} from 'three';
import type { World } from './world';

/** An object with a material. */
type Drawn = Mesh | LineSegments;

/** Maximum change of an element of the camera's matrices at rest: less than a tenth of a pixel in the cavity. */
const REST = 2e-5;

export class Backdrop {
  private readonly picture: WebGLRenderTarget;
  private readonly sheet: Mesh<PlaneGeometry, ShaderMaterial>;
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  private readonly size = new Vector2();
  /** Camera and visibility of the surroundings in the copied picture and in the last picture. */
  private drawn: number[] = [];
  private last: number[] = [];

  constructor(private readonly world: World) {
    const depthTexture = new DepthTexture(1, 1);
    this.picture = new WebGLRenderTarget(1, 1, { depthTexture, minFilter: NearestFilter, magFilter: NearestFilter });
    // Tone mapping and colour space as on the canvas: three.js applies them only to targets of this kind.
    Object.assign(this.picture, { isXRRenderTarget: true });
    this.picture.texture.colorSpace = SRGBColorSpace;
    this.picture.texture.internalFormat = 'RGBA8'; // the shaders encode the colours; the format must not encode them again
    const material = new ShaderMaterial({
      uniforms: { color: { value: this.picture.texture }, depth: { value: depthTexture } },
      vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader: `
        uniform highp sampler2D color;
        uniform highp sampler2D depth;
        void main() {
          ivec2 at = ivec2(gl_FragCoord.xy);
          gl_FragColor = texelFetch(color, at, 0);
          gl_FragDepth = texelFetch(depth, at, 0).r;
        }`,
      depthFunc: AlwaysDepth,
      toneMapped: false,
    });
    this.sheet = new Mesh(new PlaneGeometry(2, 2), material);
    this.sheet.frustumCulled = false;
  }

  /** Draw the surroundings anew before the next copy. */
  forget(): void {
    this.drawn = [];
  }

  /** Draw the scene on the whole canvas, with a copy of the opaque `still` parts if the camera is at rest. */
  draw(camera: PerspectiveCamera, still: readonly Drawn[]): void {
    const { renderer, scene } = this.world;
    renderer.getDrawingBufferSize(this.size);
    const opaque = still.filter((o) => ![o.material].flat().some((m) => m.transparent));
    const key = [
      ...this.size.toArray(),
      ...opaque.map((o) => Number(shown(o))),
      ...camera.matrixWorld.elements,
      ...camera.projectionMatrix.elements,
    ];
    const rests = same(key, this.last);
    this.last = key;
    if (!rests && !same(key, this.drawn)) {
      renderer.render(scene, camera);
      return;
    }
    if (!same(key, this.drawn)) {
      this.drawn = key;
      this.take(camera, opaque);
    }
    const { background } = scene;
    renderer.autoClear = false;
    scene.background = null;
    renderer.render(this.sheet, this.flat);
    without(opaque, () => renderer.render(scene, camera));
    scene.background = background;
    renderer.autoClear = true;
  }

  /** Draw only the surroundings into the copied picture. */
  private take(camera: PerspectiveCamera, opaque: readonly Drawn[]): void {
    const { renderer, scene } = this.world;
    const kept = new Set<Object3D>(opaque);
    const others: Object3D[] = [];
    scene.traverse((o) => {
      if ('material' in o && !kept.has(o)) others.push(o);
    });
    this.picture.setSize(this.size.x, this.size.y);
    renderer.setRenderTarget(this.picture);
    without(others, () => renderer.render(scene, camera));
    renderer.setRenderTarget(null);
  }
}

/** Draw without these objects; lamps and other objects that they carry remain. */
function without(things: readonly Object3D[], draw: () => void): void {
  const masks = things.map((o) => o.layers.mask);
  for (const thing of things) thing.layers.mask = 0;
  draw();
  things.forEach((o, i) => (o.layers.mask = masks[i] as number));
}

function shown(object: Object3D): boolean {
  for (let o: Object3D | null = object; o; o = o.parent) if (!o.visible) return false;
  return true;
}

const same = (a: readonly number[], b: readonly number[]): boolean =>
  a.length === b.length && a.every((v, i) => Math.abs(v - (b[i] as number)) < REST);
