import type { paths } from "./openapi.ts";

/** HTTP methods of the API. */
export type Method = "get" | "put" | "post" | "delete";

/** Paths that have a method. */
export type PathWith<M extends Method> = {
  [P in keyof paths]: paths[P] extends Record<M, { responses: unknown }> ? P : never;
}[keyof paths];

/** Operation of a method and path. */
export type Operation<M extends Method, P extends PathWith<M>> = paths[P] extends Record<M, infer O> ? O : never;

/** Names in braces of a path. */
type NamesIn<P> = P extends `${string}{${infer Name}}${infer Rest}` ? Name | NamesIn<Rest> : never;

/** Values of the names in braces of a path. */
export type PathValues<P> = Record<NamesIn<P>, string | number>;

/** Query parameters of an operation. */
export type QueryOf<O> = O extends { parameters: { query?: infer Q } } ? NonNullable<Q> : never;

/** JSON body of an operation's request. */
export type BodyOf<O> = O extends { requestBody?: infer R }
  ? NonNullable<R> extends { content: { "application/json": infer B } } ? B : never
  : never;

type Success = 200 | 201 | 202;
type JsonAt<R> = R extends { content: { "application/json": infer T } } ? T : never;

/** JSON answer of an operation; `undefined` for an operation without one. */
export type AnswerOf<O> = O extends { responses: infer R }
  ? [JsonAt<R[keyof R & Success]>] extends [never] ? undefined : JsonAt<R[keyof R & Success]>
  : never;

/** Fills the names in braces of a path and appends the query; absent values are left out. */
export function expandPath(path: string, values: Record<string, string | number>, query: object = {}): string {
  const filled = path.replace(/\{(\w+)\}/g, (_, name: string) => {
    const value = values[name];
    if (value === undefined) throw new Error(`the path ${path} needs a value for ${name}`);
    return encodeURIComponent(value);
  });
  const search = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) {
    if (value !== undefined && value !== null) search.set(name, String(value));
  }
  return search.size === 0 ? filled : `${filled}?${search}`;
}
