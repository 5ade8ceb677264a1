// Bundles the page into one script, one style and one document: node build.mjs [FOLDER]
import { build } from 'esbuild';
import { copyFile, mkdir, readFile, writeFile } from 'node:fs/promises';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const out = resolve(process.argv[2] ?? join(here, '../src/skywright/reports/station'));
await mkdir(out, { recursive: true });
await build({
  entryPoints: { station: join(here, 'src/main.js') },
  outdir: out, bundle: true, minify: true, format: 'esm', target: 'es2022', charset: 'utf8',
  legalComments: 'inline', absWorkingDir: here, logLevel: 'warning',
});
await build({
  entryPoints: { station: join(here, 'src/station.css') },
  outdir: out, bundle: true, minify: true, absWorkingDir: here, logLevel: 'warning',
});
const licences = [];
for (const name of ['three', 'uplot']) {
  licences.push(`${name}:\n\n${await readFile(join(here, 'node_modules', name, 'LICENSE'), 'utf8')}`);
}
await writeFile(join(out, 'LICENSES.txt'), licences.join('\n'));
await copyFile(join(here, 'src/station.html'), join(out, 'station.html'));
