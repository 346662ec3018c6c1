// glTF-Transform reads a GLB and writes it again: resave_gltf.mjs in.glb out.glb [dedup|prune|weld ...]
import { NodeIO } from '@gltf-transform/core';
import * as functions from '@gltf-transform/functions';

const [source, target, ...steps] = process.argv.slice(2);
const io = new NodeIO();
const document = await io.read(source);
if (steps.length) await document.transform(...steps.map((step) => functions[step]()));
await io.write(target, document);
console.log(JSON.stringify({ steps }));
