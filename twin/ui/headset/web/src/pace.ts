/** How long the graphics processor takes for a picture, and what to do where that is long: wait for it, and draw fewer pixels. */

import type { WebGLRenderer } from 'three';

const SHARES = [1, 0.7, 0.5, 0.35] as const; // of the pixels of a line
const SLOW = 40; // ms for a picture above which the next has fewer pixels
const FAST = 12; // ms below which, for some pictures, it has more again
const PROOF = 30; // pictures
const FULL = Math.min(window.devicePixelRatio, 2);

export class Pace {
  private fence: WebGLSync | null = null;
  private begun = 0;
  private level = 0;
  private fast = 0;
  private share = 1;

  constructor(private readonly renderer: WebGLRenderer) {}

  /** Whether pictures of things that move have fewer pixels. */
  get slow(): boolean {
    return this.level > 0;
  }

  /** Whether the last picture is still being drawn: another one now would only make a queue. */
  busy(now: number): boolean {
    const gl = this.gl;
    if (!this.fence) return false;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED && now - this.begun < 2000) return true;
    gl.deleteSync(this.fence);
    this.fence = null;
    this.judge(now - this.begun);
    return false;
  }

  /** Before a picture: choose its pixels; all of them where nothing moves. */
  begin(now: number, moving: boolean): void {
    this.begun = now;
    const share = moving ? (SHARES[this.level] as number) : 1;
    if (share === this.share) return;
    this.share = share;
    this.renderer.setPixelRatio(FULL * share);
  }

  /** After a picture. */
  end(): void {
    const gl = this.gl;
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  private judge(took: number): void {
    if (this.share !== SHARES[this.level]) return; // a sharp picture of a scene at rest
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
