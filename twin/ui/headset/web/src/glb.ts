/** Geometry files, each loaded once and as early as possible: the server lists them in the page's head. */

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

/** Start loading the files listed in the page's head, before the scene is loaded. */
export function loadEarly(): void {
  for (const link of document.querySelectorAll('link[rel=preload]')) {
    const url = link.getAttribute('href') ?? '';
    if (url.endsWith('.glb')) loadGlb(url).catch(() => undefined); // the error is reported to the caller that needs the file
  }
}
