import { Client, Problem } from "@prosopon/client";
import { INITIAL } from "../model/state.ts";
import type { Display, ShownProblem, State } from "../model/state.ts";
import { Store } from "../model/store.ts";

/** The page: its state, the client, and the life of the open session. */
export class App {
  readonly store = new Store<State>(INITIAL);
  readonly client = new Client({ token: () => this.state.token || undefined });
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
      if (!signal.aborted) this.report(during, error);
      return undefined;
    } finally {
      const at = this.state.busy.indexOf(during);
      this.set({ busy: this.state.busy.toSpliced(at, 1) });
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
}

function wordsOf(error: unknown): Pick<ShownProblem, "title" | "detail" | "faults" | "requestId"> {
  if (error instanceof Problem) {
    const { title, detail, faults, requestId } = error;
    return { title, detail, faults, requestId };
  }
  const message = error instanceof Error ? error.message : String(error);
  return { title: "The page could not do this", detail: message, faults: [], requestId: undefined };
}
