import type { components } from "./openapi.ts";

type KindOf<Type> = Type extends `/problems/${infer Kind}` ? Kind : never;

/** Type of an answer without a document, from a proxy for example. */
type Blank = "about:blank";

/** Kind of a problem: the name of a section of `api/problems.md`. */
export type ProblemKind = KindOf<components["schemas"]["ProblemType"]> | Blank;

type Described = components["schemas"]["ProblemDocument"];

/** Error document of the service, RFC 9457; of type `about:blank` where the answer had none. */
export type ProblemDocument = { [Member in keyof Described]: Member extends "type" ? Described[Member] | Blank : Described[Member] };

/** A value of the request that is not allowed. */
export type ProblemField = components["schemas"]["ProblemField"];

/** An error answer of the service, in its own words. */
export class Problem extends Error {
  /** HTTP status. */
  readonly status: number;
  /** Last part of `type`. */
  readonly kind: ProblemKind;
  /** Title of this kind of problem. */
  readonly title: string;
  /** What is wrong in this case, and what to do. */
  readonly detail: string;
  /** Values of the request that are not allowed. */
  readonly faults: readonly ProblemField[];
  /** Id of the request in the service's log. */
  readonly requestId: string | undefined;
  /** Seconds after which the service may take the request, from `Retry-After`. */
  readonly retryAfterS: number | undefined;

  constructor(document: ProblemDocument, retryAfterS?: number) {
    super(document.detail ? `${document.title}: ${document.detail}` : document.title);
    this.name = "Problem";
    this.status = document.status;
    this.kind = kindOf(document.type);
    this.title = document.title;
    this.detail = document.detail;
    this.faults = document.errors ?? [];
    this.requestId = document.request_id ?? undefined;
    this.retryAfterS = retryAfterS;
  }

  /** Reads the problem of an error answer; a proxy's answer without a document gets its status line as title. */
  static async from(response: Response): Promise<Problem> {
    const text = await response.text();
    return Problem.parse(text, response.status, response.statusText, response.headers.get("retry-after"));
  }

  /** Reads the problem from the text of an answer. */
  static parse(text: string, status: number, statusText: string, retryAfter: string | null): Problem {
    const seconds = retryAfter === null ? Number.NaN : Number(retryAfter);
    const retryAfterS = Number.isFinite(seconds) ? seconds : undefined;
    return new Problem(documentOf(text) ?? withoutDocument(text, status, statusText), retryAfterS);
  }
}

/** The service did not answer: no network, or the service is not running. */
export class Unreachable extends Error {
  constructor(url: string, cause?: unknown) {
    super(`${url} does not answer. Check the network and that the service runs.`, { cause });
    this.name = "Unreachable";
  }
}

function documentOf(text: string): ProblemDocument | undefined {
  try {
    const parsed: unknown = JSON.parse(text);
    return isProblemDocument(parsed) ? parsed : undefined;
  } catch {
    return undefined;
  }
}

function kindOf(type: ProblemDocument["type"]): ProblemKind {
  return type.slice(type.lastIndexOf("/") + 1) as ProblemKind;
}

function isProblemDocument(value: unknown): value is ProblemDocument {
  if (typeof value !== "object" || value === null) return false;
  return "type" in value && typeof value.type === "string" && "title" in value && "status" in value;
}

function withoutDocument(text: string, status: number, statusText: string): ProblemDocument {
  const title = statusText === "" ? `HTTP status ${status}` : statusText;
  return { type: "about:blank", title, status, detail: text.slice(0, 200) };
}
