// Compares two OpenAPI documents and names every change that breaks a client of the older one.
// A request may not accept less than before; a response may not hold what clients do not know. Names that generated clients use
// (operations, properties, enum values, alternatives) may not disappear.
//   node changes.mjs OLD.json NEW.json [NAME OF OLD]
// Exit 0: compatible, or info.version allows the break; 1: breaks; 2: cannot compare
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const METHODS = ["get", "put", "post", "delete", "options", "head", "patch", "trace"];

/** Every breaking change from `before` to `after`, one sentence each. */
export function breakingChanges(before, after) {
  const found = [];
  const context = { before, after, seen: new Set(), report: (place, text) => found.push(`${place}: ${text}`) };
  for (const [path, item] of Object.entries(before.paths ?? {})) {
    for (const method of METHODS.filter((method) => item[method])) {
      const place = `${method.toUpperCase()} ${path}`;
      const next = after.paths?.[path]?.[method];
      if (!next) context.report(place, "the operation was removed");
      else compareOperation(context, place, [item, item[method]], [after.paths[path], next]);
    }
  }
  return [...new Set(found)];
}

/** Whether `info.version` went up far enough for a breaking change: the minor number while the major is 0, else the major. */
export function versionAllowsBreak(before, after) {
  const [a, b] = [before, after].map((version) => /^(\d+)\.(\d+)\.\d+/.exec(version)?.slice(1).map(Number));
  if (!a || !b) return false;
  return b[0] > a[0] || (a[0] === 0 && b[0] === 0 && b[1] > a[1]);
}

function deref(document, node) {
  for (let i = 0; node?.$ref && i < 50; i++) {
    const keys = node.$ref.slice(2).split("/").map((key) => decodeURIComponent(key).replace(/~1/g, "/").replace(/~0/g, "~"));
    node = keys.reduce((at, key) => at?.[key], document);
  }
  return node;
}

function compareOperation(context, place, [oldItem, oldOperation], [newItem, newOperation]) {
  const { before, after, report } = context;
  if (oldOperation.operationId !== newOperation.operationId) {
    report(place, `operationId changed from \`${oldOperation.operationId}\` to \`${newOperation.operationId}\``);
  }
  const parameters = (document, item, operation) =>
    new Map(
      [...(item.parameters ?? []), ...(operation.parameters ?? [])].map((one) => deref(document, one)).map((one) => [`${one.in} ${one.name}`, one]),
    );
  const [oldParameters, newParameters] = [parameters(before, oldItem, oldOperation), parameters(after, newItem, newOperation)];
  for (const [key, old] of oldParameters) {
    const next = newParameters.get(key);
    if (!next) report(place, `the parameter \`${old.name}\` (${old.in}) was removed`);
    else {
      if (next.required && !old.required) report(place, `the parameter \`${old.name}\` (${old.in}) became required`);
      compareSchema(context, "request", `${place} parameter ${old.name}`, old.schema ?? {}, next.schema ?? {});
    }
  }
  for (const [key, next] of newParameters) {
    if (!oldParameters.has(key) && next.required) report(place, `a required parameter \`${next.name}\` (${next.in}) was added`);
  }

  const [oldBody, newBody] = [deref(before, oldOperation.requestBody), deref(after, newOperation.requestBody)];
  if (oldBody && !newBody) report(place, "the request body was removed");
  if (newBody?.required && !oldBody?.required) report(place, oldBody ? "the request body became required" : "a required request body was added");
  if (oldBody && newBody) compareContent(context, "request", `${place} request`, oldBody.content, newBody.content);

  for (const [status, response] of Object.entries(oldOperation.responses ?? {})) {
    const [old, next] = [deref(before, response), deref(after, newOperation.responses?.[status])];
    if (!next) {
      report(place, `the response ${status} was removed`);
      continue;
    }
    for (const [name, header] of Object.entries(old.headers ?? {})) {
      const [oldHeader, newHeader] = [deref(before, header), deref(after, next.headers?.[name])];
      if (!newHeader) report(place, `the header \`${name}\` of response ${status} was removed`);
      else compareSchema(context, "response", `${place} response ${status} header ${name}`, oldHeader.schema ?? {}, newHeader.schema ?? {});
    }
    compareContent(context, "response", `${place} response ${status}`, old.content, next.content);
  }

  const security = (document, operation) => (operation.security ?? document.security ?? [{}]).map((one) => Object.entries(one));
  const newSecurity = security(after, newOperation);
  const fits = (wanted, given) => wanted.every(([name, scopes]) => given.some(([g, s]) => g === name && scopes.every((scope) => s.includes(scope))));
  for (const given of security(before, oldOperation)) {
    if (newSecurity.length && !newSecurity.some((wanted) => fits(wanted, given))) {
      report(place, `requests with ${given.map(([name]) => name).join(" and ") || "no"} credentials are no longer accepted`);
    }
  }
}

function compareContent(context, side, place, before = {}, after = {}) {
  for (const [type, media] of Object.entries(before)) {
    if (!after[type]) context.report(place, `the media type ${type} was removed`);
    else compareSchema(context, side, place, media.schema ?? {}, after[type].schema ?? {});
  }
}

const name = (schema) => /^#\/components\/schemas\/(.+)$/.exec(schema?.$ref ?? "")?.[1];

/** Resolves references and merges `allOf`. The part for `type`, `oneOf` and so on is the conjunction as far as generators read it. */
function flatten(document, schema, depth = 0) {
  if (schema === true || schema === undefined || depth > 30) return {};
  if (schema === false) return { not: {} };
  const { $ref, allOf, ...own } = schema;
  const parts = [...($ref ? [deref(document, { $ref })] : []), ...(allOf ?? [])].map((part) => flatten(document, part, depth + 1));
  if (!parts.length) return own;
  const whole = {};
  for (const part of [...parts, own]) {
    const { properties, required, ...rest } = part;
    Object.assign(whole, rest);
    if (properties) whole.properties = { ...whole.properties, ...properties };
    if (required) whole.required = [...new Set([...(whole.required ?? []), ...required])];
  }
  return whole;
}

/** The alternatives of a schema, each of one type and with the name (`origin`) of the schema it comes from. */
function alternatives(document, schema, depth = 0) {
  const origin = name(schema);
  const found = expand(document, schema, depth);
  return origin ? found.map((one) => ({ origin, ...one })) : found;
}

/** As `alternatives`, without the name. Fixed strings of several alternatives become one. */
function expand(document, schema, depth) {
  const whole = flatten(document, schema);
  const { oneOf, anyOf, ...rest } = whole;
  const branches = oneOf ?? anyOf;
  if (branches && depth < 20) {
    const shared = rest.properties || rest.required ? { properties: rest.properties, required: rest.required } : undefined;
    const all = branches.flatMap((one) => alternatives(document, shared ? { allOf: [shared, one] } : one, depth + 1));
    const fixed = all.filter((one) => one.type === "string" && one.enum);
    if (fixed.length < 2) return all;
    return [...all.filter((one) => !fixed.includes(one)), { type: "string", enum: fixed.flatMap((one) => one.enum) }];
  }
  if ("const" in rest) rest.enum = [rest.const];
  let types = [rest.type ?? []].flat();
  if (!types.length && rest.properties) types = ["object"];
  if (!types.length && rest.enum) types = [...new Set(rest.enum.map((value) => (value === null ? "null" : typeof value)))];
  if (!types.length) return [{ ...rest, type: "any" }];
  if (rest.nullable && !types.includes("null")) types.push("null");
  return types.map((type) => {
    if (type === "null") return { type };
    const one = { ...rest, type };
    if (one.enum) one.enum = one.enum.filter((value) => value !== null);
    return one;
  });
}

/** What tells the alternative from others of its type: fixed values of its properties, else its required properties. */
function key(document, one) {
  if (one.type !== "object") return one.type;
  const tags = Object.entries(one.properties ?? {})
    .map(([property, schema]) => [property, flatten(document, schema)])
    .filter(([, schema]) => "const" in schema || schema.enum?.length === 1)
    .map(([property, schema]) => `${property}=${schema.const ?? schema.enum[0]}`);
  return `object ${tags.length ? tags.sort().join(",") : [...(one.required ?? [])].sort().join("+")}`;
}

/** Whether this comparison was made already: a named schema is compared once a side, at the first place that uses it. */
function seenBefore(context, pair) {
  if (context.seen.has(pair)) return true;
  context.seen.add(pair);
  return false;
}

const WIDER = { integer: "number" };

function compareSchema(context, side, place, before, after) {
  if (name(before) && name(after) && seenBefore(context, `${side} ${name(before)} ${name(after)}`)) return;
  if (name(before)) place += ` (${name(before)})`;
  if (side === "request") {
    const [old, next] = [flatten(context.before, before).default, flatten(context.after, after).default].map((value) => JSON.stringify(value));
    if (old !== undefined && next !== undefined && old !== next) context.report(place, `the default changed from ${old} to ${next} (request)`);
  }
  const oldOnes = alternatives(context.before, before);
  const newOnes = alternatives(context.after, after);
  const pairs = [];
  const match = (test) => {
    for (const old of [...oldOnes]) {
      const next = newOnes.find((one) => test(old, one));
      if (!next) continue;
      pairs.push([old, next]);
      oldOnes.splice(oldOnes.indexOf(old), 1);
      newOnes.splice(newOnes.indexOf(next), 1);
    }
  };
  match((old, next) => key(context.before, old) === key(context.after, next));
  match((old, next) => old.type === next.type);
  match((old, next) => (side === "request" ? WIDER[old.type] === next.type : WIDER[next.type] === old.type));
  match((old, next) => (side === "request" ? next.type === "any" && !next.not : old.type === "any"));

  const describe = (one, document) => (one.type === "object" ? key(document, one) : one.type);
  const lost = oldOnes.filter((one) => one.type !== "null" || side === "request");
  if (lost.length === 1 && newOnes.length === 1) {
    context.report(place, `the type changed from ${lost[0].type} to ${newOnes[0].type} (${side})`);
  } else {
    for (const one of lost) context.report(place, `the alternative \`${describe(one, context.before)}\` was removed (${side})`);
    if (side === "response") {
      for (const one of newOnes) context.report(place, `the alternative \`${describe(one, context.after)}\` was added (response)`);
    }
  }
  for (const [old, next] of pairs) compareAlternative(context, side, place, old, next);
}

// Keywords that bound values: the larger number is the stricter one for 1, the smaller for -1.
const BOUNDS = { minimum: 1, exclusiveMinimum: 1, minLength: 1, minItems: 1, minProperties: 1 };
Object.assign(BOUNDS, { maximum: -1, exclusiveMaximum: -1, maxLength: -1, maxItems: -1, maxProperties: -1 });

function compareAlternative(context, side, place, before, after) {
  const identity = (document, one) => one.origin && `${one.origin} ${key(document, one)}`;
  const [old, next] = [identity(context.before, before), identity(context.after, after)];
  if (old && next && seenBefore(context, `${side} alternative ${old} ${next}`)) return;
  const report = (text) => context.report(place, `${text} (${side})`);
  const request = side === "request";
  if (after.type === "any" && before.type !== "any") return;

  const forgets = request ? before.format !== undefined && after.format === undefined : before.format === undefined && after.format !== "binary";
  if (before.format !== after.format && !forgets) report(`the format changed from ${before.format ?? "none"} to ${after.format ?? "none"}`);

  if (before.enum && after.enum) {
    for (const value of before.enum.filter((value) => !after.enum.includes(value))) report(`the value \`${value}\` was removed`);
    if (!request) for (const value of after.enum.filter((value) => !before.enum.includes(value))) report(`the value \`${value}\` was added`);
  } else if (after.enum && request) report("values became limited to a list");
  else if (before.enum && !request) report("values are no longer limited to a list");

  for (const [bound, sign] of Object.entries(BOUNDS)) {
    const weakest = -sign * Infinity;
    const [old, next] = [before[bound] ?? weakest, after[bound] ?? weakest];
    if (request ? sign * next > sign * old : sign * next < sign * old) {
      report(`${bound} changed from ${before[bound] ?? "none"} to ${after[bound] ?? "none"}`);
    }
  }
  for (const strict of ["pattern", "multipleOf", "uniqueItems"]) {
    if ((request ? after : before)[strict] && before[strict] !== after[strict]) report(`${strict} changed`);
  }

  if (before.items || after.items) compareSchema(context, side, `${place}[]`, before.items ?? {}, after.items ?? {});
  compareProperties(context, side, place, before, after);
}

function compareProperties(context, side, place, before, after) {
  const report = (text) => context.report(place, `${text} (${side})`);
  const [oldProperties, newProperties] = [before.properties ?? {}, after.properties ?? {}];
  const [oldRequired, newRequired] = [before.required ?? [], after.required ?? []];
  for (const [property, schema] of Object.entries(oldProperties)) {
    if (property in newProperties) compareSchema(context, side, `${place}.${property}`, schema, newProperties[property]);
    else report(`the property \`${property}\` was removed`);
  }
  if (side === "request") {
    for (const property of newRequired.filter((one) => !oldRequired.includes(one))) {
      report(`the property \`${property}\` ${property in oldProperties ? "became required" : "was added and is required"}`);
    }
  } else {
    for (const property of oldRequired.filter((one) => !newRequired.includes(one) && one in newProperties)) {
      report(`the property \`${property}\` is no longer always present`);
    }
  }
  const [old, next] = [before.additionalProperties, after.additionalProperties];
  if (side === "request" && next === false && old !== false) report("unknown properties are no longer accepted");
  else if (typeof old === "object" && typeof next === "object") compareSchema(context, side, `${place}.*`, old, next);
  else if (typeof old === "object" && next === false) report("free property names were removed");
  else if (typeof old === "object" && next === undefined && side === "response") report("the values of free property names lost their type");
  else if (typeof next === "object" && old === undefined && side === "request") report("the values of unknown properties became limited");
}

function main([oldFile, newFile, base = oldFile]) {
  const [before, after] = [oldFile, newFile].map((file) => JSON.parse(readFileSync(file, "utf8")));
  const [from, to] = [before.info.version, after.info.version];
  const found = breakingChanges(before, after);
  if (!found.length) {
    console.log(`ok       changes   no breaking change against ${base}`);
    return 0;
  }
  const count = `${found.length} breaking change${found.length > 1 ? "s" : ""}`;
  if (versionAllowsBreak(from, to)) {
    console.log(`ok       changes   ${count}, which info.version ${from} to ${to} allows, against ${base}`);
    for (const line of found) console.log(`  ${line}`);
    return 0;
  }
  console.log(`FAILED   changes   ${count} against ${base}; info.version ${from === to ? `is still ${to}` : `went only from ${from} to ${to}`}`);
  for (const line of found) console.log(`  ${line}`);
  const [major, minor] = from.split(".").map(Number);
  const next = major ? `${major + 1}.0.0` : `0.${minor + 1}.0`;
  console.log(`Undo these changes, or raise info.version to ${next} and describe them in api/CHANGELOG.md.`);
  return 1;
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? "").href) {
  try {
    process.exitCode = main(process.argv.slice(2));
  } catch (error) {
    console.log(`FAILED   changes   the documents cannot be compared: ${error.message}`);
    process.exitCode = 2;
  }
}
