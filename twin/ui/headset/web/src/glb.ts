/** Geometry that is fetched once, as early as can be: the server tells in the page what will be asked for. */

import { type GLTF, GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

const asked = new Map<string, Promise<GLTF>>();

export function loadGlb(url: string): Promise<GLTF> {
  let found = asked.get(url);
  if (!found) {
    found = new GLTFLoader().loadAsync(url);
    asked.set(url, found);
  }
  return found;
}

/** Begin with what the page's head names, before the scene is known. */
export function loadEarly(): void {
  for (const link of document.querySelectorAll('link[rel=preload]')) {
    const url = link.getAttribute('href') ?? '';
    if (url.endsWith('.glb')) loadGlb(url).catch(() => undefined); // told to who asks for it
  }
}
