// The validator of Khronos on GLB files.
//
//   node check_glb.mjs file.glb ...
//
// Prints {file: {errors, warnings, infos, hints, messages: ["CODE at pointer: text", ...]}, version}.
import { readFileSync } from 'node:fs';
import validator from 'gltf-validator';

const out = { version: `gltf-validator ${validator.version()}` };
for (const file of process.argv.slice(2)) {
  const { issues } = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 100 });
  out[file] = {
    errors: issues.numErrors,
    warnings: issues.numWarnings,
    infos: issues.numInfos,
    hints: issues.numHints,
    messages: issues.messages.map((m) => `${m.code} at ${m.pointer}: ${m.message}`),
  };
}
console.log(JSON.stringify(out));
