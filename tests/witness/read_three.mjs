// three.js reads GLB (GLTFLoader) and USDZ (USDLoader, its own USDC parser) and plays their clips.
//
//   node read_three.mjs job.json
//
//   job: [{id, path, clip: name | "", times: [s, ...], links: [name, ...]}, ...]
//
// Prints {id: {times, duration, clips, names, links: {node: [16 numbers, row-major T_world_node, z up, m]}}}.
// three.js is y up: what it shows is turned back by +90 degrees about x, and by nothing else.
import { readFileSync } from 'node:fs';
import { AnimationMixer, LoopOnce, Matrix4, REVISION } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { USDLoader } from 'three/addons/loaders/USDLoader.js';

const zUp = new Matrix4().makeRotationX(Math.PI / 2);
const scenes = new Map();

async function load(path) {
  if (!scenes.has(path)) {
    const bytes = readFileSync(path);
    const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
    if (path.endsWith('.glb')) {
      const gltf = await new GLTFLoader().parseAsync(buffer, '');
      scenes.set(path, { scene: gltf.scene, clips: gltf.animations });
    } else {
      const scene = new USDLoader().parse(buffer);
      scenes.set(path, { scene, clips: scene.animations ?? [] });
    }
  }
  return scenes.get(path);
}

function poses(scene, wanted) {
  scene.updateMatrixWorld(true);
  const seen = {};
  scene.traverse((node) => {
    if (!wanted.includes(node.name)) return;
    const e = new Matrix4().multiplyMatrices(zUp, node.matrixWorld).elements; // column-major
    (seen[node.name] ??= []).push([0, 1, 2, 3].flatMap((r) => [0, 1, 2, 3].map((c) => e[4 * c + r])));
  });
  return seen;
}

const out = { version: `three.js r${REVISION}` };
for (const { id, path, clip, times, links: wanted } of JSON.parse(readFileSync(process.argv[2]))) {
  const { scene, clips } = await load(path);
  // A USDZ holds one motion without a name; a GLB names its clips.
  const chosen = clip ? clips.find((c) => c.name === clip) : clips[0];
  if (!chosen) {
    out[id] = { clips: clips.map((c) => c.name), links: {} };
    continue;
  }
  const mixer = new AnimationMixer(scene);
  const action = mixer.clipAction(chosen).setLoop(LoopOnce);
  action.clampWhenFinished = true;
  const links = {};
  let twice = [];
  for (const t of times) {
    action.reset().play();
    mixer.setTime(t);
    for (const [name, found] of Object.entries(poses(scene, wanted))) {
      (links[name] ??= []).push(found[0]);
      if (found.length > 1 && !twice.includes(name)) twice.push(name);
    }
  }
  mixer.stopAllAction();
  mixer.uncacheRoot(scene);
  out[id] = { times, duration: chosen.duration, clips: clips.map((c) => c.name), twice, links };
}
console.log(JSON.stringify(out));
