// Bundles src/ to dist/: one script, one style sheet, one page, and the notices of what is bundled.
// The output depends on nothing but the sources and the lock file: a rebuild is byte-identical.
import { build } from 'esbuild';
import { cpSync, mkdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, 'dist');
rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });

const result = await build({
  absWorkingDir: here,
  entryPoints: ['src/main.ts', 'src/style.css'],
  outdir: out,
  entryNames: 'twin',
  bundle: true,
  minify: true,
  format: 'esm',
  target: 'es2022',
  legalComments: 'none', // the complete licences of the bundled packages are in THIRD_PARTY.txt
  metafile: true,
  logLevel: 'warning',
});

const packages = new Set();
for (const file of Object.keys(result.metafile.inputs)) {
  const match = /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(file);
  if (match) packages.add(match[1]);
}
const notices = [...packages].sort().map((name) => {
  const folder = join(here, 'node_modules', name);
  const about = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
  const licence = readFileSync(join(folder, 'LICENSE'), 'utf8').replace(/\r\n/g, '\n').trim();
  return `${name} ${about.version} (${about.license})\n\n${licence}\n`;
});
const head = 'twin.js of this folder contains parts of the following works, under their own licences.\n';
writeFileSync(join(out, 'THIRD_PARTY.txt'), [head, ...notices].join(`\n${'-'.repeat(80)}\n\n`));
for (const name of ['index.html', 'icon.svg']) cpSync(join(here, 'src', name), join(out, name));
