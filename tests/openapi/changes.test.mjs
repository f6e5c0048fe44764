// Hand-made changes of a small document: the breaking ones are found, the harmless ones pass.
import assert from "node:assert/strict";
import { test } from "node:test";
import { breakingChanges, versionAllowsBreak } from "./changes.mjs";

const ref = (name) => ({ $ref: `#/components/schemas/${name}` });
const json = (schema) => ({ "application/json": { schema } });

const object = (required) => ({ type: "object", required: [required] });

function base() {
  const problem = { description: "A problem.", content: { "application/problem+json": { schema: { type: "object" } } } };
  return {
    openapi: "3.1.0",
    info: { title: "Test", version: "0.1.0" },
    security: [{}, { bearer: [] }],
    paths: {
      "/jobs": {
        get: {
          operationId: "listJobs",
          parameters: [{ name: "after", in: "query", schema: { type: "string", default: "a" } }],
          responses: { 200: { description: "Jobs.", content: json({ type: "array", items: ref("Job") }) }, default: problem },
        },
        post: {
          operationId: "createJob",
          requestBody: { required: true, content: { ...json(ref("Order")), "application/xml": {} } },
          responses: {
            202: { description: "A job.", headers: { Location: { schema: { type: "string" } } }, content: json(ref("Job")) },
            304: { description: "Same." },
          },
        },
      },
      "/jobs/{job}": { delete: { operationId: "deleteJob", responses: { 204: { description: "Deleted." } } } },
    },
    components: {
      schemas: {
        Linked: { type: "object", required: ["self"], properties: { self: { type: "string" } } },
        Job: {
          allOf: [
            ref("Linked"),
            {
              type: "object",
              required: ["state"],
              properties: {
                state: { type: "string", enum: ["running", "done"] },
                parent: { oneOf: [ref("Job"), { type: "null" }] },
                share: { type: "number" },
                event: { oneOf: [{ type: "null" }, ref("Event")] },
                place: { type: "array", items: { type: "number" }, minItems: 3, maxItems: 3 },
              },
            },
          ],
        },
        Event: {
          oneOf: ["start", "end"].map((event) => ({
            type: "object",
            required: ["event", "data"],
            properties: { event: { type: "string", enum: [event] }, data: { type: "string" } },
          })),
        },
        Order: {
          type: "object",
          required: ["kind"],
          properties: {
            kind: { type: "string", enum: ["fast", "exact"] },
            count: { type: "integer", maximum: 10 },
            law: { oneOf: [ref("Ogden"), { type: "object", required: ["c10"], properties: { c10: { type: "number" } } }, { type: "null" }] },
          },
        },
        Ogden: { type: "object", required: ["alpha"], properties: { alpha: { type: "number" } } },
      },
    },
  };
}

const schema = (document, name) => document.components.schemas[name];
const job = (document) => schema(document, "Job").allOf[1];
const order = (document) => schema(document, "Order");
const list = (document) => document.paths["/jobs"].get;
const create = (document) => document.paths["/jobs"].post;

const breaking = {
  "path removed": (d) => delete d.paths["/jobs/{job}"],
  "operation removed": (d) => delete d.paths["/jobs"].post,
  "operationId changed": (d) => (list(d).operationId = "jobs"),
  "parameter removed": (d) => list(d).parameters.pop(),
  "parameter became required": (d) => (list(d).parameters[0].required = true),
  "required parameter added": (d) => list(d).parameters.push({ name: "x", in: "query", required: true, schema: { type: "string" } }),
  "parameter's type changed": (d) => (list(d).parameters[0].schema.type = "integer"),
  "parameter's default changed": (d) => (list(d).parameters[0].schema.default = "b"),
  "media type of a request removed": (d) => delete create(d).requestBody.content["application/xml"],
  "request body removed": (d) => delete create(d).requestBody,
  "response status removed": (d) => delete create(d).responses[304],
  "problem response removed": (d) => delete list(d).responses.default,
  "response header removed": (d) => delete create(d).responses[202].headers,
  "response body removed": (d) => delete create(d).responses[202].content,
  "response property removed": (d) => delete job(d).properties.share,
  "inherited response property removed": (d) => delete schema(d, "Linked").properties.self,
  "response property became optional": (d) => (job(d).required = []),
  "response property became null": (d) => (job(d).properties.share.type = ["number", "null"]),
  "response property's type changed": (d) => (job(d).properties.share.type = "string"),
  "response array lost its length": (d) => delete job(d).properties.place.maxItems,
  "alternative with a tag changed": (d) => (schema(d, "Event").oneOf[1].properties.data.type = "number"),
  "alternative with a tag added": (d) => schema(d, "Event").oneOf.push({ ...object("event"), properties: { event: { const: "pause" } } }),
  "response enum value added": (d) => job(d).properties.state.enum.push("lost"),
  "response enum value removed": (d) => job(d).properties.state.enum.pop(),
  "response enum opened": (d) => delete job(d).properties.state.enum,
  "request enum value removed": (d) => order(d).properties.kind.enum.pop(),
  "request property removed": (d) => delete order(d).properties.count,
  "required request property added": (d) => (order(d).properties.x = { type: "string" }) && order(d).required.push("x"),
  "request property became required": (d) => order(d).required.push("count"),
  "request bound tightened": (d) => (order(d).properties.count.maximum = 5),
  "request alternative removed": (d) => order(d).properties.law.oneOf.shift(),
  "null no longer accepted": (d) => order(d).properties.law.oneOf.pop(),
  "alternative got a required property": (d) => schema(d, "Ogden").required.push("mu"),
  "unknown request properties refused": (d) => (order(d).additionalProperties = false),
  "credentials became necessary": (d) => d.security.shift(),
};

const harmless = {
  nothing: () => {},
  "operation added": (d) => (d.paths["/jobs/{job}"].get = { operationId: "getJob", responses: { 200: { description: "A job." } } }),
  "response added": (d) => (list(d).responses[304] = { description: "Same." }),
  "optional parameter added": (d) => list(d).parameters.push({ name: "x", in: "query", schema: { type: "string" } }),
  "optional request property added": (d) => (order(d).properties.x = { type: "string" }),
  "request property became optional": (d) => (order(d).required = []),
  "request enum value added": (d) => order(d).properties.kind.enum.push("rough"),
  "request bound loosened": (d) => delete order(d).properties.count.maximum,
  "request integer became a number": (d) => (order(d).properties.count.type = "number"),
  "request property accepts null": (d) => (order(d).properties.count.type = ["integer", "null"]),
  "request alternative added": (d) => order(d).properties.law.oneOf.push({ type: "string", enum: ["preset"] }),
  "response property added": (d) => (job(d).properties.x = { type: "string" }),
  "response property always present": (d) => job(d).required.push("share"),
  "response property never null": (d) => (job(d).properties.parent = ref("Job")),
  "response number is an integer": (d) => (job(d).properties.share.type = "integer"),
  "descriptions and examples": (d) => (job(d).description = "A job.") && (order(d).example = { kind: "fast" }),
  "alternatives in another order": (d) => order(d).properties.law.oneOf.reverse(),
  "schema renamed": (d) =>
    (d.components.schemas.Command = order(d)) && (create(d).requestBody.content = { ...json(ref("Command")), "application/xml": {} }),
  "allOf written out": (d) =>
    (d.components.schemas.Job = { ...job(d), required: ["self", "state"], properties: { self: { type: "string" }, ...job(d).properties } }),
};

for (const [title, change] of Object.entries(breaking)) {
  test(`breaking: ${title}`, () => {
    const after = base();
    change(after);
    assert.notEqual(breakingChanges(base(), after).length, 0);
  });
}
for (const [title, change] of Object.entries(harmless)) {
  test(`harmless: ${title}`, () => {
    const after = base();
    change(after);
    assert.deepEqual(breakingChanges(base(), after), []);
  });
}

test("versions that allow a breaking change", () => {
  for (const [from, to] of [["0.1.0", "0.2.0"], ["0.1.3", "0.2.0"], ["0.9.0", "1.0.0"], ["1.2.0", "2.0.0"]]) {
    assert.ok(versionAllowsBreak(from, to), `${from} ${to}`);
  }
  for (const [from, to] of [["0.1.0", "0.1.0"], ["0.1.0", "0.1.1"], ["0.2.0", "0.1.0"], ["1.2.0", "1.3.0"], ["1.0.0", "0.2.0"]]) {
    assert.ok(!versionAllowsBreak(from, to), `${from} ${to}`);
  }
});
