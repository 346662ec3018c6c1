/** Draw three squares with this device's graphics, and compare pixels with the known places and colours. */

import {
  Mesh,
  MeshBasicMaterial,
  NoColorSpace,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  WebGLRenderer,
  WebGLRenderTarget,
} from 'three';

interface Result {
  name: string;
  verdict: 'pass' | 'FAIL' | 'not here';
  said: string;
}

const SIZE = 64;

/** Colour and centre (x, y in m on the plane z = 0) of each square; its edge is 0.3 m. */
const SQUARES: [string, number, number][] = [
  ['ff0000', 0.5, 0],
  ['00ff00', 0, 0.5],
  ['0000ff', -0.5, -0.5],
];

/**
 * The camera is 1 m in front of the plane, with an angle of view of 90 degrees: 1 m of the plane is half of the picture,
 * so that the pixel of a point is known without a matrix.
 */
export function checkPicture(webgl2: boolean): Result[] {
  const name = 'a picture has the right colours at the right places';
  if (!webgl2) return [{ name, verdict: 'FAIL', said: 'no WebGL 2' }];
  const renderer = new WebGLRenderer({ canvas: document.createElement('canvas') });
  const target = new WebGLRenderTarget(SIZE, SIZE, { colorSpace: NoColorSpace });
  const scene = new Scene();
  for (const [color, x, y] of SQUARES) {
    const square = new Mesh(
      new PlaneGeometry(0.3, 0.3),
      new MeshBasicMaterial({ color: `#${color}`, toneMapped: false }),
    );
    square.position.set(x, y, 0);
    scene.add(square);
  }
  const camera = new PerspectiveCamera(90, 1, 0.1, 10);
  camera.position.z = 1;
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const wrong: string[] = [];
  const pixel = new Uint8Array(4);
  for (const [color, x, y] of SQUARES) {
    const [px, py] = [Math.round((SIZE / 2) * (1 + x)), Math.round((SIZE / 2) * (1 + y))];
    renderer.readRenderTargetPixels(target, px, py, 1, 1, pixel);
    const seen = [...pixel.subarray(0, 3)].map((v) => v.toString(16).padStart(2, '0')).join('');
    if (seen !== color) wrong.push(`${color} is ${seen}`);
  }
  target.dispose();
  renderer.dispose();
  renderer.forceContextLoss();
  return [{ name, verdict: wrong.length ? 'FAIL' : 'pass', said: wrong.join(', ') || '3 of 3 colours' }];
}
