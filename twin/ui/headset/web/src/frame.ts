/** A binary frame of the stream: poses of all links of all robots, and vertices of deformables, at one time. */

export const MAGIC = 0x314e5754;
const SCENE_MAGIC = 0x324e5754;
const HEAD = 32;
const BOX = 28;

export const GHOST = 1;
export const PLAYING = 2;
export const REFUSED = 4;
export const HELD = 8;

export interface Frame {
  seq: number;
  serverTime: number;
  clipTime: number;
  flags: number;
  /** x y z qx qy qz qw of each link, in the robot's base (z up, m). */
  poses: Float32Array;
  /** Active joints, m or rad. */
  q: Float32Array;
  /** Tool pose computed by the equations; null without a ghost. */
  ghost: Float32Array | null;
  /** Bytes of the displayed content, as received. */
  body: Uint8Array;
}

/** Quantised vertices: low + step * level, in m in the world frame. */
export interface Field {
  low: Float32Array;
  step: Float32Array;
  levels: Uint16Array;
  body: Uint8Array;
}

export interface SceneFrame {
  seq: number;
  /** Time in s: of the scene's clock, or of the protocol of a single robot. */
  time: number;
  robots: Frame[];
  fields: Field[];
}

/** Whether two frames have equal content: poses, joints, ghost, flags and time in the protocol. */
export function sameFrame(a: Frame, b: Frame | null): boolean {
  return b !== null && a.flags === b.flags && a.clipTime === b.clipTime && sameBytes(a.body, b.body);
}

export function sameBytes(a: Uint8Array, b: Uint8Array | undefined): boolean {
  return b !== undefined && a.length === b.length && a.every((value, i) => value === b[i]);
}

/** Return the frame of a scene or of a single robot. Throws an Error that describes the defect. */
export function parseScene(buffer: ArrayBuffer): SceneFrame {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEAD) throw new Error(`a frame of ${buffer.byteLength} bytes has no complete header`);
  if (view.getUint32(0, true) !== SCENE_MAGIC) {
    const robot = parseFrame(buffer);
    return { seq: robot.seq, time: robot.clipTime, robots: [robot], fields: [] };
  }
  const scene: SceneFrame = { seq: view.getUint32(4, true), time: view.getFloat64(16, true), robots: [], fields: [] };
  let at = HEAD;
  for (let i = view.getUint16(24, true); i > 0; i--) {
    const end = at + sizeOf(buffer, at);
    scene.robots.push(parseFrame(buffer, at, end));
    at = end;
  }
  for (let i = view.getUint16(26, true); i > 0; i--) {
    if (buffer.byteLength < at + BOX) throw new Error(`a frame of ${buffer.byteLength} bytes has no complete field at byte ${at}`);
    const count = view.getUint32(at, true);
    const end = at + BOX + 4 * Math.ceil((6 * count) / 4);
    if (buffer.byteLength < end) throw new Error(`a frame of ${buffer.byteLength} bytes is truncated: a field ends at byte ${end}`);
    scene.fields.push({
      low: new Float32Array(buffer, at + 4, 3),
      step: new Float32Array(buffer, at + 16, 3),
      levels: new Uint16Array(buffer, at + BOX, 3 * count),
      body: new Uint8Array(buffer, at, end - at),
    });
    at = end;
  }
  if (at !== buffer.byteLength) throw new Error(`a frame of ${buffer.byteLength} bytes, ${at} expected`);
  return scene;
}

/** Return the frame of one robot in a part of a message. Throws an Error that describes the defect. */
export function parseFrame(buffer: ArrayBuffer, at = 0, end = buffer.byteLength): Frame {
  const wanted = sizeOf(buffer, at);
  if (end - at !== wanted || end > buffer.byteLength)
    throw new Error(`a frame of ${buffer.byteLength - at} bytes, ${wanted} expected`);
  const view = new DataView(buffer, at);
  const links = view.getUint16(24, true);
  const joints = view.getUint16(26, true);
  const flags = view.getUint32(28, true);
  const numbers = new Float32Array(buffer, at + HEAD, (wanted - HEAD) / 4);
  return {
    seq: view.getUint32(4, true),
    serverTime: view.getFloat64(8, true),
    clipTime: view.getFloat64(16, true),
    flags,
    poses: numbers.subarray(0, 7 * links),
    q: numbers.subarray(7 * links, 7 * links + joints),
    ghost: flags & GHOST ? numbers.subarray(7 * links + joints) : null,
    body: new Uint8Array(buffer, at + HEAD, wanted - HEAD),
  };
}

/** Return the length in bytes, from the header, of the robot's frame at `at`. */
function sizeOf(buffer: ArrayBuffer, at: number): number {
  if (buffer.byteLength - at < HEAD) throw new Error(`a frame of ${buffer.byteLength - at} bytes has no complete header`);
  const view = new DataView(buffer, at);
  if (view.getUint32(0, true) !== MAGIC) throw new Error('a frame does not begin with TWN1');
  const ghost = (view.getUint32(28, true) & GHOST) !== 0;
  return HEAD + 4 * (7 * view.getUint16(24, true) + view.getUint16(26, true) + (ghost ? 7 : 0));
}
