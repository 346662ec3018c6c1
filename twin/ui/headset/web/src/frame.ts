/** One binary frame of the stream: the poses of all links at one moment. */

export const MAGIC = 0x314e5754;
const HEAD = 32;

export const GHOST = 1;
export const PLAYING = 2;
export const REFUSED = 4;
export const HELD = 8;

export interface Frame {
  seq: number;
  serverTime: number;
  clipTime: number;
  flags: number;
  /** x y z qx qy qz qw of each link, in the world of the robot (z up, m). */
  poses: Float32Array;
  /** Active joints, m or rad. */
  q: Float32Array;
  /** The tool by the equations, or null. */
  ghost: Float32Array | null;
}

/** Whether two frames look the same: poses, joints, ghost, flags and time in the protocol. */
export function sameFrame(a: Frame, b: Frame | null): boolean {
  if (b === null || a.flags !== b.flags || a.clipTime !== b.clipTime) return false;
  const [x, y] = [new Uint8Array(a.poses.buffer, HEAD), new Uint8Array(b.poses.buffer, HEAD)];
  return x.length === y.length && x.every((value, i) => value === y[i]);
}

/** Return the frame in a message. Throws an Error that says what is wrong with it. */
export function parseFrame(buffer: ArrayBuffer): Frame {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEAD) throw new Error(`a frame of ${buffer.byteLength} bytes has no whole head`);
  if (view.getUint32(0, true) !== MAGIC) throw new Error('a frame without the mark TWN1');
  const links = view.getUint16(24, true);
  const joints = view.getUint16(26, true);
  const flags = view.getUint32(28, true);
  const ghost = (flags & GHOST) !== 0;
  const wanted = HEAD + 4 * (7 * links + joints + (ghost ? 7 : 0));
  if (buffer.byteLength !== wanted) throw new Error(`a frame of ${buffer.byteLength} bytes, ${wanted} expected`);
  const numbers = new Float32Array(buffer, HEAD);
  return {
    seq: view.getUint32(4, true),
    serverTime: view.getFloat64(8, true),
    clipTime: view.getFloat64(16, true),
    flags,
    poses: numbers.subarray(0, 7 * links),
    q: numbers.subarray(7 * links, 7 * links + joints),
    ghost: ghost ? numbers.subarray(7 * links + joints) : null,
  };
}
