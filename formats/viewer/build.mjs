// Makes viewer.js.gz of main.js and the libraries of package-lock.json: npm ci && npm run build
import { build } from "esbuild";
import { writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const { outputFiles } = await build({
  entryPoints: ["main.js"],
  bundle: true,
  minify: true,
  write: false,
  format: "iife",
  globalName: "lgsViewer",
  target: "es2022",
  define: { "import.meta.url": '""' },
  legalComments: "none",
});
// No name and no time in the header: the same input gives the same bytes.
const packed = gzipSync(outputFiles[0].contents, { level: 9 });
writeFileSync("viewer.js.gz", packed);
console.log(`viewer.js.gz: ${packed.length} bytes of ${outputFiles[0].contents.length}`);
