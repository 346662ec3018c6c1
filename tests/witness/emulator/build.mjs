// Bundles the emulator into the file that is named.
import { build } from 'esbuild';
import { dirname } from 'node:path';
import { fileURLToPath } from 'node:url';

await build({
  absWorkingDir: dirname(fileURLToPath(import.meta.url)),
  entryPoints: ['emulator.mjs'],
  outfile: process.argv[2],
  bundle: true,
  minify: true,
  format: 'iife',
  external: ['../captures/*'], // the rooms that are not asked for, 0.4 to 2 MB each
  logLevel: 'warning',
});
