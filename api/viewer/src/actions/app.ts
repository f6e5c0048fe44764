import { Client, Problem } from "@prosopon/client";
import { isAway, REPEAT_MS, serviceAddress } from "./connection.ts";
import { INITIAL } from "../model/state.ts";
import type { Display, ShownProblem, State } from "../model/state.ts";
import { Store } from "../model/store.ts";

/** The page: its state, the client, and the life of the open session. */
export class App {
  readonly store = new Store<State>(INITIAL);
  readonly client = new Client({
    baseUrl: serviceAddress(),
    token: () => this.state.token || undefined,
    fetch: (input, init) => this.#fetch(input, init),
  });
  #scope = new AbortController();
  #nextId = 1;

  get state(): Readonly<State> {
    return this.store.state;
  }

  /** Aborted when another session is opened. */
  get signal(): AbortSignal {
    return this.#scope.signal;
  }

  /** Ends all work of the open session. */
  newScope(): void {
    this.#scope.abort(new DOMException("another session was opened", "AbortError"));
    this.#scope = new AbortController();
  }

  set(patch: Partial<State>): void {
    this.store.set(patch);
  }

  display(patch: Partial<Display>): void {
    this.set({ display: { ...this.state.display, ...patch } });
  }

  nextId(): number {
    return this.#nextId++;
  }

  /**
   * Does work for which the user waits, and shows its problem if it fails.
   *
   * @returns the result, or `undefined` after a problem or when another session was opened
   */
  async attempt<T>(during: string, work: () => Promise<T>): Promise<T | undefined> {
    const { signal } = this;
    this.set({ busy: [...this.state.busy, during] });
    try {
      return await work();
    } catch (error) {
      if (!signal.aborted && !this.#asksForFirstToken(error)) this.report(during, error);
      return undefined;
    } finally {
      const at = this.state.busy.indexOf(during);
      this.set({ busy: this.state.busy.toSpliced(at, 1) });
    }
  }

  /** `attempt` for a read, which it repeats for as long as the service is away. */
  load<T>(during: string, read: () => Promise<T>): Promise<T | undefined> {
    return this.attempt(during, () => this.patiently(read));
  }

  /** Repeats a read for as long as the service is away; the page says so meanwhile. */
  async patiently<T>(read: () => Promise<T>): Promise<T> {
    const { signal } = this;
    for (;;) {
      try {
        return await read();
      } catch (error) {
        signal.throwIfAborted();
        if (!isAway(error)) throw error;
        this.set({ interrupted: true });
        await new Promise((done) => setTimeout(done, REPEAT_MS));
        signal.throwIfAborted();
      }
    }
  }

  /** Shows a problem in the service's own words. */
  report(during: string, error: unknown): void {
    const problem: ShownProblem = { id: this.nextId(), during, ...wordsOf(error) };
    this.set({ problems: [problem, ...this.state.problems].slice(0, 20) });
  }

  dismiss(id: number): void {
    this.set({ problems: this.state.problems.filter((problem) => problem.id !== id) });
  }

  /** Sends a request and notes whether the service answers, and whether it wants a token. */
  async #fetch(input: RequestInfo | URL, init?: RequestInit): Promise<Response> {
    try {
      const response = await fetch(input, init);
      if (response.status === 401) this.set({ needsToken: true });
      if (response.status < 500 && this.state.interrupted) this.set({ interrupted: false });
      return response;
    } catch (error) {
      if (!init?.signal?.aborted) this.set({ interrupted: true });
      throw error;
    }
  }

  /** Without a token a refusal is no fault of the user: the page asks for one instead. */
  #asksForFirstToken(error: unknown): boolean {
    return error instanceof Problem && error.status === 401 && this.state.token === "";
  }
}

function wordsOf(error: unknown): Pick<ShownProblem, "title" | "detail" | "faults" | "requestId"> {
  if (error instanceof Problem) {
    const { title, detail, faults, requestId } = error;
    return { title, detail, faults, requestId };
  }
  const message = error instanceof Error ? error.message : String(error);
  return { title: "The page could not do this", detail: message, faults: [], requestId: undefined };
}
