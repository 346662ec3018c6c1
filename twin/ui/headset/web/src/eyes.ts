/**
 * Stereo endoscope: a camera and a picture for each eye, and a combined picture for red-cyan glasses or for a monitor
 * whose rows are polarised in turn.
 */

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

/** How both pictures are combined in one: by colour, or by rows. */
export type Combined = 'red-cyan' | 'rows';

const COLOURS = `
        void main() {
          float l = dot(texture2D(left, at).rgb, weight);
          float r = dot(texture2D(right, at).rgb, weight);
          gl_FragColor = vec4(l, r, r, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`;

// Row 0 is the upper row of the canvas; gl_FragCoord counts from the lower one, in its middle.
const ROWS = `
        void main() {
          float row = height - 0.5 - gl_FragCoord.y;
          gl_FragColor = vec4((mod(row + odd, 2.0) < 0.5 ? texture2D(left, at) : texture2D(right, at)).rgb, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`;

export class Eyes {
  readonly left = new PerspectiveCamera();
  readonly right = new PerspectiveCamera();
  private readonly pictures: Partial<Record<Eye, WebGLRenderTarget>> = {};
  private readonly sheets: Record<Combined, Mesh<PlaneGeometry, ShaderMaterial>>;
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  /** Distance in m between the lenses, and from the lenses to the intersection of their lines of sight; 0: no stereo. */
  constructor(private readonly stereo: readonly [baseline: number, converge: number] = [0, 1]) {
    for (const eye of EYES) this[eye].matrixAutoUpdate = this[eye].matrixWorldAutoUpdate = false;
    // By colour, only brightness is used: red surfaces of the cavity would be black through the cyan glass.
    this.sheets = { 'red-cyan': sheet(COLOURS), rows: sheet(ROWS) };
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

  /**
   * Draw the pictures of both eyes over each other on the canvas: the left eye is red, or has the even rows from the top.
   * `swapped`: the left eye has the odd rows.
   */
  overlay(renderer: WebGLRenderer, how: Combined, swapped = false): void {
    const { uniforms } = this.sheets[how].material;
    for (const eye of EYES) (uniforms[eye] as { value: unknown }).value = this.pictures[eye]?.texture ?? null;
    (uniforms['height'] as { value: number }).value = renderer.domElement.height;
    (uniforms['odd'] as { value: number }).value = swapped ? 1 : 0;
    renderer.render(this.sheets[how], this.flat);
  }
}

function sheet(main: string): Mesh<PlaneGeometry, ShaderMaterial> {
  const material = new ShaderMaterial({
    uniforms: { left: { value: null }, right: { value: null }, height: { value: 0 }, odd: { value: 0 } },
    vertexShader: 'varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }',
    fragmentShader: `
        varying vec2 at;
        uniform sampler2D left;
        uniform sampler2D right;
        uniform float height;
        uniform float odd;
        const vec3 weight = vec3(0.2126, 0.7152, 0.0722);
        ${main}`,
    depthTest: false,
    depthWrite: false,
  });
  const made = new Mesh(new PlaneGeometry(2, 2), material);
  made.frustumCulled = false;
  return made;
}
