/** Measure the drawing time of pictures; on slow graphics processors, wait for each picture and draw fewer pixels. */

import type { WebGLRenderer } from 'three';

const SHARES = [1, 0.7, 0.5, 0.35] as const; // fraction of the pixels along each axis
const SLOW = 40; // ms per picture above which the next picture has fewer pixels
const FAST = 12; // ms per picture below which, after `PROOF` pictures, the next one has more pixels
const PROOF = 30; // number of pictures
const FULL = Math.min(window.devicePixelRatio, 2);

export class Pace {
  private fence: WebGLSync | null = null;
  private begun = 0;
  private level = 0;
  private fast = 0;
  private share = 1;

  constructor(private readonly renderer: WebGLRenderer) {}

  /** Whether pictures of moving objects have fewer pixels. */
  get slow(): boolean {
    return this.level > 0;
  }

  /** Whether the last picture is still being drawn; a new picture would only be queued. */
  busy(now: number): boolean {
    const gl = this.gl;
    if (!this.fence) return false;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED && now - this.begun < 2000) return true;
    gl.deleteSync(this.fence);
    this.fence = null;
    this.judge(now - this.begun);
    return false;
  }

  /** Choose the number of pixels before a picture; all pixels if nothing moves. */
  begin(now: number, moving: boolean): void {
    this.begun = now;
    const share = moving ? (SHARES[this.level] as number) : 1;
    if (share === this.share) return;
    this.share = share;
    this.renderer.setPixelRatio(FULL * share);
  }

  /** Measure the time after a picture. */
  end(): void {
    const gl = this.gl;
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  private judge(took: number): void {
    if (this.share !== SHARES[this.level]) return; // pictures of a scene at rest do not count
    this.fast = took < FAST ? this.fast + 1 : 0;
    if (took > SLOW && this.level < SHARES.length - 1) this.level++;
    else if (this.fast > PROOF && this.level > 0) {
      this.level--;
      this.fast = 0;
    }
  }

  private get gl(): WebGL2RenderingContext {
    return this.renderer.getContext() as WebGL2RenderingContext;
  }
}
