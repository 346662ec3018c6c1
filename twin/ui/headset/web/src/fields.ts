/** Deformables: surfaces whose vertices are in every frame. */

import { BufferAttribute, BufferGeometry, Color, DoubleSide, Group, Mesh, MeshStandardMaterial } from 'three';
import { type Field, sameBytes } from './frame';
import type { FieldInfo } from './protocol';
import { layTissue, tissueTexture } from './tissue';

export class Fields {
  /** Group below the world node (z up). */
  readonly group = new Group();
  private readonly meshes: Mesh[] = [];
  /** Number of coordinates that the triangles of each field require. */
  private readonly needed: number[] = [];
  private readonly shown: (Uint8Array | undefined)[] = [];

  /** Create a mesh for each field, without vertices. */
  meet(infos: readonly FieldInfo[]): void {
    for (const info of infos) {
      const geometry = new BufferGeometry();
      const corners = new Uint32Array(bytesOf(info.triangles).buffer);
      geometry.setIndex(new BufferAttribute(corners, 1));
      this.needed.push(3 * (corners.reduce((a, b) => Math.max(a, b), -1) + 1));
      const [r, g, b] = info.color;
      const material = new MeshStandardMaterial({
        color: new Color().setRGB(r ?? 1, g ?? 1, b ?? 1),
        map: tissueTexture(),
        roughness: 0.48, // wet
        side: DoubleSide,
        opacity: info.opacity,
        transparent: info.opacity < 1,
      });
      const mesh = new Mesh(geometry, material);
      mesh.name = info.name;
      mesh.castShadow = mesh.receiveShadow = info.opacity >= 1;
      mesh.frustumCulled = false; // its bounding box changes with every frame
      mesh.visible = false;
      this.meshes.push(mesh);
      this.group.add(mesh);
    }
  }

  /** Set the vertices from a frame; return whether a new picture is needed. */
  update(fields: readonly Field[]): boolean {
    let news = false;
    this.meshes.forEach((mesh, i) => {
      const field = fields[i];
      if (!field || sameBytes(field.body, this.shown[i])) return;
      this.shown[i] = field.body;
      // No vertices: unknown at this time.
      mesh.visible = field.levels.length > 0 && field.levels.length >= (this.needed[i] ?? 0);
      if (mesh.visible) bend(mesh.geometry, field);
      news = true;
    });
    return news;
  }

  /** Return the drawn vertices of a field in the world frame. For tests. */
  vertices(name: string): number[] {
    const mesh = this.meshes.find((m) => m.name === name && m.visible);
    return mesh ? [...mesh.geometry.getAttribute('position').array] : [];
  }
}

function bend(geometry: BufferGeometry, { low, step, levels }: Field): void {
  let position = geometry.getAttribute('position') as BufferAttribute | undefined;
  if (position?.array.length !== levels.length) {
    position = new BufferAttribute(new Float32Array(levels.length), 3);
    geometry.dispose(); // the size of a GPU buffer cannot change
    geometry.deleteAttribute('normal');
    geometry.setAttribute('position', position);
    geometry.deleteAttribute('uv');
  }
  for (let k = 0; k < levels.length; k++)
    position.array[k] = (low[k % 3] as number) + (step[k % 3] as number) * (levels[k] as number);
  position.needsUpdate = true;
  if (!geometry.hasAttribute('uv')) layTissue(geometry);
  geometry.computeVertexNormals();
}

export function bytesOf(base64: string): Uint8Array {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}
