// Prints the gzipped size of the built files and fails above the limit.
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";

const LIMIT_KB = 350;
const folder = new URL("dist", import.meta.url).pathname;
const files = readdirSync(folder, { recursive: true, withFileTypes: true }).filter((entry) => entry.isFile());
const bytes = files.map((entry) => gzipSync(readFileSync(join(entry.parentPath, entry.name))).length);
const total = bytes.reduce((sum, size) => sum + size, 0) / 1000;
console.log(`${files.length} files, ${total.toFixed(1)} kB gzipped (limit ${LIMIT_KB} kB)`);
if (total > LIMIT_KB) process.exit(1);
