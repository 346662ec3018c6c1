/** Measure the drawing time of pictures; on slow graphics, draw pictures of moving objects with lower quality. */

import type { WebGLRenderer } from 'three';

/** Fraction of the pixels along each axis, by level from 0; from level 1 on, still surroundings are drawn only once. */
const SHARES = [1, 1, 0.7, 0.5, 0.35] as const;
const SLOW = 22; // ms per picture above which, twice in sequence, the next picture has a lower quality
const FAST = 12; // ms per picture below which, after enough pictures in sequence, the next one has a higher quality
/** Initial and maximum number of these fast pictures; it doubles with each reduction, so that quality does not alternate. */
const PROOF = [30, 480] as const;
const POLL = 2; // ms between two checks whether a picture is drawn
const LOST = 2000; // ms after which a picture counts as drawn
const FULL = Math.min(window.devicePixelRatio, 2);

export class Pace {
  /** Quality of pictures of moving objects: 0 is full quality. */
  level = 0;
  /** Time in ms at which the last picture was begun. */
  begun = 0;
  /** Whether each picture has exactly the pixels of the screen, at any speed. */
  exact = false;
  /** Called when a picture is drawn. */
  onDrawn: () => void = () => undefined;
  private fence: WebGLSync | null = null;
  private fast = 0;
  private slowly = 0;
  private proof: number = PROOF[0];
  private ratio = FULL;
  private moving = false;
  private counts = false;

  /** `software`: pictures are drawn by software, without a graphics processor; the lowest quality is then the first. */
  constructor(
    private readonly renderer: WebGLRenderer,
    readonly software: boolean,
  ) {
    this.step(software ? SHARES.length - 1 : 0);
  }

  /** Whether pictures of moving objects have a lower quality. */
  get slow(): boolean {
    return this.level > 0;
  }

  /** Whether the present picture has a lower quality. */
  get reduced(): boolean {
    return this.slow && this.moving;
  }

  /** Whether the last picture is still being drawn; a new picture would only be queued. */
  get busy(): boolean {
    return this.fence !== null;
  }

  /** Choose the quality before a picture; full quality if nothing moves. */
  begin(moving: boolean): void {
    this.begun = performance.now();
    this.moving = moving;
    this.counts = moving || !this.slow; // on slow graphics, pictures of a scene at rest do not count
    const share = moving ? (SHARES[this.level] as number) : 1;
    const ratio = this.exact ? window.devicePixelRatio : FULL * share;
    if (ratio === this.ratio) return;
    this.ratio = ratio;
    this.renderer.setPixelRatio(ratio);
  }

  /** Do not wait for the last picture: the canvas was cleared, and would stay empty until then. */
  forget(): void {
    this.gl.deleteSync(this.fence);
    this.fence = null;
  }

  /** Do not count this picture: it contains more than others. */
  except(): void {
    this.counts = false;
  }

  /** Measure the time after a picture. */
  end(): void {
    const { gl } = this;
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    window.setTimeout(() => this.check(), POLL);
  }

  /** Text on the quality of pictures of moving objects. */
  text(): string {
    if (!this.slow) return 'Graphics: full quality';
    const by = this.software ? 'no graphics processor' : 'slow';
    const percent = Math.round(100 * (SHARES[this.level] as number));
    return `Graphics: ${by}. Moving pictures have ${percent} % of the pixels along each axis (reduction ${this.level} of ${SHARES.length - 1}); still pictures have full quality.`;
  }

  private check(): void {
    const { gl, fence } = this;
    if (!fence) return;
    const took = performance.now() - this.begun;
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED && took < LOST) {
      window.setTimeout(() => this.check(), POLL);
      return;
    }
    gl.deleteSync(fence);
    this.fence = null;
    if (this.counts) this.judge(took);
    this.onDrawn();
  }

  private judge(took: number): void {
    this.fast = took < FAST ? this.fast + 1 : 0;
    this.slowly = took > SLOW ? this.slowly + 1 : 0;
    if (this.slowly > 1 && this.level < SHARES.length - 1) {
      this.proof = Math.min(2 * this.proof, PROOF[1]);
      this.step(this.level + 1);
    } else if (this.fast > this.proof && this.level > 0) this.step(this.level - 1);
  }

  private step(level: number): void {
    this.level = level;
    this.fast = this.slowly = 0;
    // Translucent panels and their shadows are drawn by the same slow renderer.
    document.documentElement.toggleAttribute('data-slow', level > 0);
  }

  private get gl(): WebGL2RenderingContext {
    return this.renderer.getContext() as WebGL2RenderingContext;
  }
}
