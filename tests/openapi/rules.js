// Rules of our own for the linter: what generators of clients need and its recommended rules do not check.

const JSON_TYPE = /^application\/(.+\+)?json$/;
const NUMBER = new Set(["number", "integer"]);
// Properties that hold one point or one direction in patient coordinates.
const POINT_NAME =
  /^(.*_)?(point|points|normal|axis|pivot|centroid|centre|translation|direction|position|displacement|place|part|min|max|gradients|force)(_mm|_n)?$/;

/** Types that a schema admits, as a set of JSON type names; empty: any. */
function typesOf(schema) {
  if (schema.type) return new Set([schema.type].flat());
  if (schema.properties || schema.required) return new Set(["object"]);
  const values = valuesOf(schema);
  if (!values) return new Set();
  return new Set(values.map((value) => (value === null ? "null" : Array.isArray(value) ? "array" : typeof value)));
}

function valuesOf(schema) {
  return "const" in schema ? [schema.const] : schema.enum;
}

/** The schema behind a `$ref`, with the parts of `allOf` merged as far as types, properties and required names go. */
function flatten(schema, resolve, depth = 0) {
  if (!schema || depth > 20) return {};
  if (schema.$ref) {
    const { $ref, ...beside } = schema;
    return { ...flatten(resolve({ $ref }).node, resolve, depth + 1), ...beside };
  }
  if (!schema.allOf) return schema;
  const whole = { ...schema, properties: { ...schema.properties }, required: [...(schema.required ?? [])] };
  for (const part of schema.allOf.map((one) => flatten(one, resolve, depth + 1))) {
    whole.type ??= part.type;
    Object.assign(whole.properties, part.properties);
    whole.required.push(...(part.required ?? []));
  }
  return whole;
}

/** The alternatives of a schema, those of alternatives included. */
function expand(schema, resolve, depth = 0) {
  const whole = flatten(schema, resolve);
  const inner = whole.oneOf ?? whole.anyOf;
  return inner && depth < 10 ? inner.flatMap((one) => expand(one, resolve, depth + 1)) : [whole];
}

/** Whether the alternative cannot have the property, except as null. */
function excludes(alternative, name) {
  const property = alternative.properties?.[name];
  if (property) return [property.type].flat().every((type) => type === "null");
  return alternative.additionalProperties === false;
}

/** Whether no value can match both alternatives, by type, by fixed values or by required and excluded properties. */
function disjoint(a, b) {
  const [types, others] = [typesOf(a), typesOf(b)];
  if (types.size === 0 || others.size === 0) return false;
  const shared = [...types].filter((type) => others.has(type) || (NUMBER.has(type) && [...others].some((o) => NUMBER.has(o))));
  if (shared.length === 0) return true;
  const [values, otherValues] = [valuesOf(a), valuesOf(b)];
  if (values && otherValues) return !values.some((value) => otherValues.includes(value));
  if (shared.length !== 1 || shared[0] !== "object") return false;
  const [required, otherRequired] = [a.required ?? [], b.required ?? []];
  for (const name of required.filter((name) => otherRequired.includes(name))) {
    const tags = valuesOf(a.properties?.[name] ?? {});
    const otherTags = valuesOf(b.properties?.[name] ?? {});
    if (tags && otherTags && !tags.some((tag) => otherTags.includes(tag))) return true;
  }
  const parts = (one, other) =>
    (one.required ?? []).some((name) => excludes(other, name) && !typesOf(one.properties?.[name] ?? {}).has("null"));
  if (parts(a, b) || parts(b, a)) return true;
  return required.length > 0 && otherRequired.length > 0 && !required.some((name) => otherRequired.includes(name));
}

function operationIdCamelCase() {
  return {
    Operation(operation, { report, location }) {
      const id = operation.operationId;
      if (id && !/^[a-z][a-zA-Z0-9]*$/.test(id)) {
        report({ message: `operationId \`${id}\` is not camelCase.`, location: location.child("operationId") });
      }
    },
  };
}

function operationTags() {
  return {
    Operation(operation, { report, location }) {
      if (!operation.tags?.length) report({ message: "The operation has no tag.", location: location.key() });
    },
  };
}

function problemResponse() {
  return {
    Operation(operation, { report, location, resolve }) {
      const found = Object.entries(operation.responses ?? {}).some(
        ([status, response]) =>
          /^(default|[45]..)$/.test(status) && (response.$ref ? resolve(response).node : response)?.content?.["application/problem+json"]?.schema,
      );
      if (!found) {
        report({ message: "No response `default`, 4xx or 5xx has a schema for application/problem+json.", location: location.key() });
      }
    },
  };
}

function propertyDescription() {
  return {
    Schema(schema, { report, location, resolve }) {
      for (const [name, property] of Object.entries(schema.properties ?? {})) {
        const alternatives = [property, ...(property.oneOf ?? property.anyOf ?? property.allOf ?? [])];
        const described = alternatives.some((one) => one.description || (one.$ref && resolve(one).node?.description));
        if (!described) {
          report({ message: `Property \`${name}\` has no description.`, location: location.child(["properties", name]) });
        }
      }
    },
  };
}

function requestExample() {
  return {
    RequestBody(body, { report, location, resolve }) {
      for (const [type, media] of Object.entries(body.content ?? {})) {
        if (!JSON_TYPE.test(type)) continue;
        const schema = flatten(media.schema, resolve);
        if (media.example === undefined && !media.examples && schema.example === undefined && !schema.examples?.length) {
          report({ message: "The JSON body has no example.", location: location.child(["content", type]) });
        }
      }
    },
  };
}

// Words that annotate a schema and exclude no value.
const ANNOTATIONS = new Set(["title", "description", "default", "example", "examples", "deprecated", "readOnly", "writeOnly"]);

/** A schema that excludes nothing must be marked with `x-any: true`. */
function noAnySchema() {
  const accepts = (schema) => schema === true || (schema && schema["x-any"] !== true && Object.keys(schema).every((key) => ANNOTATIONS.has(key)));
  return {
    Schema(schema, { report, location }) {
      if (accepts(schema)) report({ message: "The schema accepts anything. Give a type, or mark it with `x-any: true`." });
      for (const key of ["additionalProperties", "items"]) {
        if (schema[key] === true) report({ message: `\`${key}: true\` accepts anything. Give a schema.`, location: location.child(key) });
      }
      if ([schema.type].flat().includes("array") && schema.items === undefined && !schema.prefixItems) {
        report({ message: "The array has no `items`." });
      }
    },
  };
}

const isArray = (schema) => [schema?.type].flat().includes("array");
const isNumbers = (schema) => isArray(schema) && NUMBER.has(schema.items?.type);
const isFixed = (schema) => schema.minItems !== undefined && schema.minItems === schema.maxItems;

/** Arrays of numbers inside arrays are points and need a fixed length; a property with the name of a point has three numbers. */
function pointLength() {
  return {
    Schema(schema, { report, location }) {
      if (isArray(schema) && isNumbers(schema.items) && !isFixed(schema.items)) {
        report({ message: "The inner array of numbers has no fixed length (minItems = maxItems).", location: location.child("items") });
      }
      const want = (name, array, length, place) => {
        if (array.minItems === length && array.maxItems === length) return;
        report({ message: `\`${name}\` must have minItems = maxItems = ${length}.`, location: place });
      };
      for (const [name, property] of Object.entries(schema.properties ?? {})) {
        const place = location.child(["properties", name]);
        const { items, additionalProperties: map } = property;
        if (/^quaternion/.test(name) && isNumbers(property)) want(name, property, 4, place);
        if (!POINT_NAME.test(name) && name !== "landmarks") continue;
        if (isNumbers(property)) want(name, property, 3, place);
        else if (isArray(property) && isNumbers(items) && isFixed(items)) want(name, items, 3, place.child("items"));
        else if (isNumbers(map)) want(name, map, 3, place.child("additionalProperties"));
      }
    },
  };
}

function oneOfDecidable() {
  return {
    Schema(schema, { report, location, resolve }) {
      for (const key of ["oneOf", "anyOf"]) {
        if (!schema[key] || schema.discriminator) continue;
        const alternatives = schema[key].map((one) => expand(one, resolve));
        for (let i = 0; i < alternatives.length; i++) {
          for (let j = i + 1; j < alternatives.length; j++) {
            if (!alternatives[i].every((one) => alternatives[j].every((other) => disjoint(one, other)))) {
              report({
                message: `Alternatives ${i} and ${j} of ${key} can both match. Add a discriminator, or disjoint required properties.`,
                location: location.child([key, j]),
              });
            }
          }
        }
      }
    },
  };
}

export default function prosopon() {
  return {
    id: "prosopon",
    rules: {
      oas3: {
        "operation-id-camel-case": operationIdCamelCase,
        "operation-tags": operationTags,
        "problem-response": problemResponse,
        "property-description": propertyDescription,
        "request-example": requestExample,
        "no-any-schema": noAnySchema,
        "point-length": pointLength,
        "one-of-decidable": oneOfDecidable,
      },
    },
  };
}
