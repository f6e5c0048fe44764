// A document with one fault a rule: the linter reports each at its place.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { lint } from "./lint.mjs";

const described = (schema) => ({ description: "What it is.", ...schema });
const numbers = { type: "array", items: { type: "number" } };
const object = (required) => ({ type: "object", required: [required], properties: { [required]: described({ type: "string" }) } });
const excluding = (name) => ({ type: "object", properties: { [name]: described({ type: "null" }) } });

const document = {
  openapi: "3.1.0",
  info: { title: "Test", version: "0.1.0", license: { name: "MIT", identifier: "MIT" } },
  servers: [{ url: "/" }],
  security: [{}],
  tags: [{ name: "a", description: "Tests." }],
  paths: {
    "/a": {
      post: {
        operationId: "Bad_Name",
        summary: "Test",
        parameters: [{ name: "k", in: "query", schema: { type: "integer" } }],
        requestBody: {
          content: {
            "application/json": {
              schema: {
                type: "object",
                properties: {
                  plain: { type: "string" },
                  anything: described({}),
                  marked: described({ "x-any": true }),
                  point_mm: described(numbers),
                  good_mm: described({ ...numbers, minItems: 3, maxItems: 3 }),
                  rows: described({ type: "array", items: numbers }),
                  either: described({ oneOf: [{ type: "string" }, { type: "string", maxLength: 3 }] }),
                  excluded: described({ oneOf: [object("c"), excluding("c")] }),
                  optional: described({ oneOf: [object("c"), { type: "object", properties: { c: described({ type: "string" }) } }] }),
                  decided: described({ oneOf: [object("a"), { oneOf: [object("b"), { type: "boolean" }] }, { type: "null" }] }),
                },
              },
            },
          },
        },
        responses: { 200: { description: "Done." } },
      },
    },
  },
};

test("each rule reports its fault, and nothing else is reported", () => {
  const folder = mkdtempSync(join(tmpdir(), "openapi-"));
  try {
    const file = join(folder, "openapi.json");
    writeFileSync(file, JSON.stringify(document));
    const found = lint(fileURLToPath(new URL("redocly.yaml", import.meta.url)), file);
    const body = "#/paths/~1a/post/requestBody/content/application~1json";
    assert.deepEqual(found.map((one) => `${one.rule} ${one.pointer}`).sort(), [
      "operation-tag-defined #/paths/~1a/post",
      "parameter-description #/paths/~1a/post/parameters/0",
      `prosopon/no-any-schema ${body}/schema/properties/anything`,
      `prosopon/one-of-decidable ${body}/schema/properties/either/oneOf/1`,
      `prosopon/one-of-decidable ${body}/schema/properties/optional/oneOf/1`,
      "prosopon/operation-id-camel-case #/paths/~1a/post/operationId",
      "prosopon/operation-tags #/paths/~1a/post",
      `prosopon/point-length ${body}/schema/properties/point_mm`,
      `prosopon/point-length ${body}/schema/properties/rows/items`,
      "prosopon/problem-response #/paths/~1a/post",
      `prosopon/property-description ${body}/schema/properties/plain`,
      `prosopon/request-example ${body}`,
    ]);
  } finally {
    rmSync(folder, { recursive: true });
  }
});
