/** Light of a room, which shiny parts reflect: a small bright room around the scene, blurred once for each roughness. */

import {
  type HemisphereLight,
  type Material,
  MeshStandardMaterial,
  type Object3D,
  PMREMGenerator,
  type Scene,
  type Texture,
  type WebGLRenderer,
} from 'three';
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js';

const BRIGHT = 0.26; // intensity of the room's light
const INSIDE = 0.06; // the same inside a patient, where it comes through the ports only
const REST = 0.5; // part of the lamp's light from all sides that stays beside the room's light

export class Reflections {
  private texture: Texture | null = null;
  private readonly intensity: number;
  private on = false;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly scene: Scene,
    private readonly lamp: HemisphereLight,
  ) {
    this.intensity = lamp.intensity;
    scene.environmentIntensity = BRIGHT;
  }

  /** Switch the room's light on or off; it is computed when it is first switched on. */
  show(on: boolean): void {
    if (on === this.on) return;
    this.on = on;
    if (on) this.texture ??= roomOf(this.renderer);
    this.scene.environment = on ? this.texture : null;
    this.lamp.intensity = on ? REST * this.intensity : this.intensity;
    polish(this.scene, on);
  }

  /** Draw a picture inside a patient. */
  inside(draw: () => void): void {
    this.scene.environmentIntensity = INSIDE;
    draw();
    this.scene.environmentIntensity = BRIGHT;
  }
}

/** Give the parts the metal of their files, which is black where nothing can be reflected. */
function polish(scene: Object3D, on: boolean): void {
  scene.traverse((o) => {
    const { material } = o as Partial<{ material: Material | Material[] }>;
    for (const m of [material ?? []].flat()) {
      if (!(m instanceof MeshStandardMaterial)) continue;
      const [metal, matt] = [m.userData['metalness'], m.userData['dullness']] as [number?, number?];
      if (metal !== undefined && matt !== undefined) m.metalness = on ? metal : matt;
    }
  });
}

function roomOf(renderer: WebGLRenderer): Texture {
  const room = new RoomEnvironment();
  const generator = new PMREMGenerator(renderer);
  const { texture } = generator.fromScene(room, 0.04);
  generator.dispose();
  room.dispose();
  return texture;
}
