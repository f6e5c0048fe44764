// Runs the linter on a document and prints what it finds, grouped by rule, as JSON pointers.
//   node lint.mjs CONFIG DOCUMENT
import { spawnSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

/** Problems of the document: rule, pointer, message. */
export function lint(config, document) {
  const program = fileURLToPath(new URL("node_modules/@redocly/cli/bin/cli.js", import.meta.url));
  const result = spawnSync(process.execPath, [program, "lint", "--config", config, "--format", "json", "--max-problems", "10000", document], {
    encoding: "utf8",
    maxBuffer: 1 << 28,
    env: { ...process.env, REDOCLY_TELEMETRY: "off", REDOCLY_SUPPRESS_UPDATE_NOTICE: "true" },
  });
  let answer;
  try {
    answer = JSON.parse(result.stdout);
  } catch {
    throw new Error(`the linter gave no result:\n${result.error ?? result.stderr}`);
  }
  return answer.problems.map((one) => ({ rule: one.ruleId, pointer: one.location[0]?.pointer ?? "#/", message: one.message }));
}

/** Rules that redocly.yaml turns off until the document is mended. */
function rulesOff(config) {
  return [...readFileSync(config, "utf8").matchAll(/^ {2}([\w/-]+): off$/gm)].map((one) => one[1]);
}

function main([config, document]) {
  const problems = lint(config, document);
  const off = config.endsWith("redocly.yaml") ? rulesOff(config) : [];
  if (!problems.length) {
    console.log(`ok       lint      no problem${off.length ? `; ${off.length} rules are off: ${off.join(", ")}` : ""}`);
    return 0;
  }
  console.log(`FAILED   lint      ${problems.length} problems`);
  const groups = new Map();
  for (const one of problems) groups.set(one.rule, [...(groups.get(one.rule) ?? []), one]);
  for (const [rule, ones] of [...groups].sort()) {
    console.log(`  ${rule}: ${ones.length}`);
    for (const { pointer, message } of ones) console.log(`    ${pointer}  ${message.split("\n")[0]}`);
  }
  console.log("Mend the types and handlers in src that describe these places, then run: prosopon openapi > api/openapi.json");
  return 1;
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  try {
    process.exitCode = main(process.argv.slice(2));
  } catch (error) {
    console.log(`FAILED   lint      ${error.message}`);
    process.exitCode = 2;
  }
}
