/** Colours and materials of all drawn objects except the robots. */

import { Color, MeshBasicMaterial } from 'three';

export const BLUE = 0x2268c9;
/** Blue for additive displays, on which dark blue is hardly visible. */
const LIGHT_BLUE = 0x62adff;
export const ORANGE = 0xe07b00;
export const RED = 0xd81b2a;
export const VIOLET = 0x8a3fd1;

const accented: { color: Color }[] = [];
/** Present colour of objects that can be grabbed or pressed; it depends on the display. */
export let accent = BLUE;

/** Give a material the colour of objects that can be grabbed or pressed, and keep it up to date. */
export function accentuate<M extends { color: Color }>(material: M): M {
  material.color.setHex(accent);
  accented.push(material);
  return material;
}

export function setAccent(additive: boolean): void {
  accent = additive ? LIGHT_BLUE : BLUE;
  for (const material of accented) material.color.setHex(accent);
}

/** Return a material with one colour, independent of light. */
export function flat(color: number, opacity = 1): MeshBasicMaterial {
  return new MeshBasicMaterial({
    color,
    opacity,
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
    toneMapped: false,
  });
}
