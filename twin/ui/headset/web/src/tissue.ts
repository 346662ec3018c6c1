/** The look of soft tissue: blotches and fine vessels, drawn once into a small picture that repeats. */

import { BufferAttribute, type BufferGeometry, CanvasTexture, MirroredRepeatWrapping, SRGBColorSpace } from 'three';

const SIDE = 256; // pixels of the picture along each axis
const PERIOD = 0.07; // m of tissue that the picture covers
const UPRIGHT = 0.4; // motion in the picture per motion along z, so that upright walls have a pattern too
const VESSELS = 26;
const STEPS = 70; // of a vessel
const STRIDE = 2.2; // px of a step
const BLOTCHES = 420;

let picture: CanvasTexture | null = null;

/** Return the picture; it multiplies the colour of the organ, and is the same in every page. */
export function tissueTexture(): CanvasTexture {
  if (picture) return picture;
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = SIDE;
  const pen = canvas.getContext('2d');
  if (pen) {
    const random = randomOf(7);
    pen.fillStyle = '#f4e9e4';
    pen.fillRect(0, 0, SIDE, SIDE);
    for (let k = 0; k < BLOTCHES; k++) blotch(pen, random);
    for (let k = 0; k < VESSELS; k++) vessel(pen, random);
  }
  picture = new CanvasTexture(canvas);
  picture.wrapS = picture.wrapT = MirroredRepeatWrapping; // the picture has no seam at its rim
  picture.colorSpace = SRGBColorSpace;
  return picture;
}

/** Lay the picture over the present vertices, from above; the pattern then moves with the vertices. */
export function layTissue(geometry: BufferGeometry): void {
  const at = geometry.getAttribute('position');
  const uv = new Float32Array(2 * at.count);
  for (let i = 0; i < at.count; i++) {
    uv[2 * i] = (at.getX(i) + UPRIGHT * at.getZ(i)) / PERIOD;
    uv[2 * i + 1] = (at.getY(i) - UPRIGHT * at.getZ(i)) / PERIOD;
  }
  geometry.setAttribute('uv', new BufferAttribute(uv, 2));
}

function blotch(pen: CanvasRenderingContext2D, random: () => number): void {
  const [x, y, r] = [SIDE * random(), SIDE * random(), 4 + 20 * random() ** 2];
  const dark = random() < 0.6;
  const glow = pen.createRadialGradient(x, y, 0, x, y, r);
  glow.addColorStop(0, dark ? '#a04a4430' : '#fff8f038');
  glow.addColorStop(1, dark ? '#a04a4400' : '#fff8f000');
  pen.fillStyle = glow;
  pen.fillRect(x - r, y - r, 2 * r, 2 * r);
}

/** Draw a vessel: a walk whose direction changes slowly, with a side branch. */
function vessel(pen: CanvasRenderingContext2D, random: () => number): void {
  let [x, y, angle] = [SIDE * random(), SIDE * random(), 2 * Math.PI * random()];
  const width = 0.5 + 1.1 * random();
  pen.strokeStyle = random() < 0.7 ? '#8e1f2a66' : '#4a3a6a4d';
  for (let k = 0; k < STEPS; k++) {
    const [fromX, fromY] = [x, y];
    angle += 0.7 * (random() - 0.5);
    x += STRIDE * Math.cos(angle);
    y += STRIDE * Math.sin(angle);
    pen.lineWidth = width * (1 - k / STEPS) + 0.3;
    pen.beginPath();
    pen.moveTo(fromX, fromY);
    pen.lineTo(x, y);
    pen.stroke();
    if (k % 24 !== 12) continue;
    const side = angle + (random() < 0.5 ? 1 : -1);
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(x + 14 * Math.cos(side), y + 14 * Math.sin(side));
    pen.stroke();
  }
}

/** Return a function that returns the same random numbers in 0..1 for the same seed (mulberry32). */
function randomOf(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}
