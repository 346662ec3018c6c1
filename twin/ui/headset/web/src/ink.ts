/** Colours and materials of what is drawn beside the robots. */

import { Color, MeshBasicMaterial } from 'three';

export const BLUE = 0x2268c9;
/** The same for displays that add light: a dark blue would hardly be seen. */
const LIGHT_BLUE = 0x62adff;
export const ORANGE = 0xe07b00;
export const RED = 0xd81b2a;
export const VIOLET = 0x8a3fd1;

const accented: { color: Color }[] = [];
/** The colour of what can be taken and pressed, as the display needs it now. */
export let accent = BLUE;

/** Let a material have the colour of what can be taken and pressed, as the display needs it. */
export function accentuate<M extends { color: Color }>(material: M): M {
  material.color.setHex(accent);
  accented.push(material);
  return material;
}

export function setAccent(additive: boolean): void {
  accent = additive ? LIGHT_BLUE : BLUE;
  for (const material of accented) material.color.setHex(accent);
}

/** A material that shows one colour and takes no light. */
export function flat(color: number, opacity = 1): MeshBasicMaterial {
  return new MeshBasicMaterial({
    color,
    opacity,
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
    toneMapped: false,
  });
}
