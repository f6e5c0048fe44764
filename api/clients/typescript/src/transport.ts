import { expandPath } from "./paths.ts";
import type { AnswerOf, BodyOf, Method, Operation, PathValues, PathWith, QueryOf } from "./paths.ts";
import { Problem, Unreachable } from "./problem.ts";

/** Settings of a client. */
export interface ClientOptions {
  /** Address of the service without a slash at its end; empty for the page's own origin. */
  baseUrl?: string;
  /** Returns the bearer token for each request; none when absent or `undefined`. */
  token?: () => string | undefined;
  /** Replaces the global `fetch`. */
  fetch?: typeof fetch;
}

/** Inputs of one JSON call. */
export interface CallInput<O, P> {
  path?: PathValues<P>;
  query?: QueryOf<O>;
  body?: BodyOf<O>;
  signal?: AbortSignal | undefined;
}

/** Waits before each repetition of a request that may be repeated, ms. */
const REPEAT_AFTER_MS = [500, 1000, 2000, 4000];

/** Sends requests with the token and turns error answers into `Problem`. */
export class Transport {
  readonly #baseUrl: string;
  readonly #token: () => string | undefined;
  readonly #fetch: typeof fetch;

  constructor(options: ClientOptions = {}) {
    this.#baseUrl = options.baseUrl ?? "";
    this.#token = options.token ?? (() => undefined);
    this.#fetch = options.fetch ?? ((input, init) => fetch(input, init));
  }

  /** URL of a path of the API. */
  url(path: string): string {
    return this.#baseUrl + path;
  }

  /** `Authorization` header, when there is a token. */
  authorization(): Record<string, string> {
    const token = this.#token();
    return token ? { authorization: `Bearer ${token}` } : {};
  }

  /**
   * Sends one request.
   *
   * @throws Problem for an error answer, Unreachable without an answer, and the signal's reason when it is aborted.
   */
  async fetch(path: string, init: RequestInit & { headers?: Record<string, string> } = {}): Promise<Response> {
    const url = this.url(path);
    const headers = { ...this.authorization(), ...init.headers };
    const response = await this.#fetch(url, { ...init, headers }).catch((cause: unknown) => {
      init.signal?.throwIfAborted();
      throw new Unreachable(url, cause);
    });
    if (!response.ok) throw await Problem.from(response);
    return response;
  }

  /**
   * Sends a JSON request and reads the JSON answer.
   *
   * It repeats reads and creations while the service is unreachable or refuses work for now. A creation carries an idempotency
   * key, so that the service carries it out once.
   */
  async call<M extends Method, P extends PathWith<M>>(
    method: M,
    path: P,
    input: CallInput<Operation<M, P>, P> = {},
  ): Promise<AnswerOf<Operation<M, P>>> {
    const headers: Record<string, string> = { accept: "application/json" };
    if (method === "post") headers["idempotency-key"] = randomKey();
    const init: RequestInit & { headers: Record<string, string> } = { method: method.toUpperCase(), headers };
    if (input.body !== undefined) {
      headers["content-type"] = "application/json";
      init.body = JSON.stringify(input.body);
    }
    if (input.signal) init.signal = input.signal;
    const expanded = expandPath(path, input.path ?? {}, input.query);
    const response = await repeating(() => this.fetch(expanded, init), input.signal);
    return (response.status === 204 ? undefined : await response.json()) as AnswerOf<Operation<M, P>>;
  }

  /** Reads a binary or text result. */
  async read<P extends PathWith<"get">>(
    path: P,
    input: { path?: PathValues<P>; query?: QueryOf<Operation<"get", P>>; signal?: AbortSignal | undefined } = {},
  ): Promise<Response> {
    const init = input.signal ? { signal: input.signal } : {};
    return repeating(() => this.fetch(expandPath(path, input.path ?? {}, input.query), init), input.signal);
  }
}

/** Waits; rejects with the signal's reason when it is aborted. */
export function pause(ms: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const stop = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resolve();
    }, ms);
    if (signal?.aborted) stop();
    else signal?.addEventListener("abort", stop, { once: true });
  });
}

/** Whether the same request may succeed later: the service is away or refuses work for now. */
export function isPassing(error: unknown): boolean {
  if (!(error instanceof Problem)) return error instanceof Unreachable;
  // A proxy in front of a service that is away answers without a problem document, some with 500.
  return [502, 503, 504].includes(error.status) || (error.status === 500 && error.kind === "about:blank");
}

async function repeating(send: () => Promise<Response>, signal?: AbortSignal): Promise<Response> {
  for (const waitMs of REPEAT_AFTER_MS) {
    try {
      return await send();
    } catch (error) {
      if (!isPassing(error)) throw error;
      const asked = error instanceof Problem ? (error.retryAfterS ?? 0) * 1000 : 0;
      await pause(Math.max(waitMs, Math.min(asked, 10_000)), signal);
    }
  }
  return send();
}

/** `crypto.randomUUID` exists only on secure pages; a service in a local network may have none. */
function randomKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
