/** The grey line of the camera task: horizontal, in the middle of the endoscope's picture, before everything else. */

import { Mesh, MeshBasicMaterial, PlaneGeometry } from 'three';

const GREY = 0x9a9a9a;
const THICK = 0.006; // as a fraction of the height of the picture
const AWAY = 0.08; // distance in m from the lens of an endoscope with one lens

/** Return the line for a camera that looks along -z; `view` in rad; `away`: its distance from the lenses in m. */
export function lineOf(length: number, view: number, layer: number, away = AWAY): Mesh {
  const height = 2 * away * Math.tan(view / 2);
  const material = new MeshBasicMaterial({ color: GREY, depthTest: false, depthWrite: false, toneMapped: false });
  const line = new Mesh(new PlaneGeometry(length * height, THICK * height), material);
  line.name = 'line';
  line.position.z = -away;
  line.renderOrder = 1000;
  line.layers.set(layer);
  return line;
}
