// three.js reads a GLB of deformables (GLTFLoader) and plays its clip.
//
//   node read_bends.mjs file.glb 0.25,0.5,...
//
// Prints {version, meshes: {name: [[x, y, z, ...] at each time]}}, vertices in the World, z up, m.
import { readFileSync } from 'node:fs';
import { AnimationMixer, LoopOnce, Matrix4, REVISION, Vector3 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

const bytes = readFileSync(process.argv[2]);
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const { scene, animations } = await new GLTFLoader().parseAsync(buffer, '');
const mixer = new AnimationMixer(scene);
const action = mixer.clipAction(animations[0]).setLoop(LoopOnce);
action.clampWhenFinished = true;
const zUp = new Matrix4().makeRotationX(Math.PI / 2);
const meshes = {};
for (const t of process.argv[3].split(',').map(Number)) {
  action.reset().play();
  mixer.setTime(t);
  scene.updateMatrixWorld(true);
  scene.traverse((node) => {
    if (!node.isMesh) return;
    const T = new Matrix4().multiplyMatrices(zUp, node.matrixWorld);
    const p = new Vector3();
    const at = [];
    for (let i = 0; i < node.geometry.getAttribute('position').count; i++) {
      node.getVertexPosition(i, p).applyMatrix4(T);
      at.push(p.x, p.y, p.z);
    }
    (meshes[node.name] ??= []).push(at);
  });
}
console.log(JSON.stringify({ version: `three.js r${REVISION}`, meshes }));
