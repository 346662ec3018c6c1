/** Stereo endoscope: a camera and a picture for each eye, and a combined picture for red-cyan glasses. */

import {
  HalfFloatType,
  Mesh,
  OrthographicCamera,
  PerspectiveCamera,
  PlaneGeometry,
  ShaderMaterial,
  type WebGLRenderer,
  WebGLRenderTarget,
} from 'three';

export type Eye = 'left' | 'right';
export const EYES: readonly Eye[] = ['left', 'right'];

export class Eyes {
  readonly left = new PerspectiveCamera();
  readonly right = new PerspectiveCamera();
  private readonly pictures: Partial<Record<Eye, WebGLRenderTarget>> = {};
  private readonly sheet: Mesh<PlaneGeometry, ShaderMaterial>;
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  /** Distance in m between the lenses, and from the lenses to the intersection of their lines of sight; 0: no stereo. */
  constructor(private readonly stereo: readonly [baseline: number, converge: number] = [0, 1]) {
    for (const eye of EYES) this[eye].matrixAutoUpdate = this[eye].matrixWorldAutoUpdate = false;
    const material = new ShaderMaterial({
      uniforms: { left: { value: null }, right: { value: null } },
      vertexShader: 'varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }',
      // Only brightness is used: red surfaces of the cavity would be black through the cyan glass.
      fragmentShader: `
        varying vec2 at;
        uniform sampler2D left;
        uniform sampler2D right;
        const vec3 weight = vec3(0.2126, 0.7152, 0.0722);
        void main() {
          float l = dot(texture2D(left, at).rgb, weight);
          float r = dot(texture2D(right, at).rgb, weight);
          gl_FragColor = vec4(l, r, r, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`,
      depthTest: false,
      depthWrite: false,
    });
    this.sheet = new Mesh(new PlaneGeometry(2, 2), material);
    this.sheet.frustumCulled = false;
  }

  /** Place both cameras at the sides of a given camera; their pictures agree at the distance of convergence. */
  follow(middle: PerspectiveCamera): void {
    const [baseline, converge] = this.stereo;
    for (const eye of EYES) {
      const camera = this[eye];
      const x = (eye === 'left' ? -baseline : baseline) / 2;
      camera.matrixWorld.makeTranslation(x, 0, 0).premultiply(middle.matrixWorld);
      camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
      camera.projectionMatrix.copy(middle.projectionMatrix);
      const e = camera.projectionMatrix.elements;
      e[8] -= (e[0] * x) / converge;
      camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    }
  }

  /** Return the render target of an eye with this size in pixels; it is created at the first call. */
  picture(eye: Eye, width: number, height: number): WebGLRenderTarget {
    const picture = (this.pictures[eye] ??= new WebGLRenderTarget(width, height, { samples: 4, type: HalfFloatType }));
    picture.setSize(width, height);
    return picture;
  }

  /** Draw the pictures of both eyes over each other on the current render target; red is the left eye. */
  overlay(renderer: WebGLRenderer): void {
    const { uniforms } = this.sheet.material;
    for (const eye of EYES) (uniforms[eye] as { value: unknown }).value = this.pictures[eye]?.texture ?? null;
    renderer.render(this.sheet, this.flat);
  }
}
