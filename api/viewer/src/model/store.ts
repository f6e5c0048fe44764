/** Holds the state of the page and reports its changes, at most once an animation frame. */
export class Store<T extends object> {
  #state: T;
  readonly #listeners: ((state: T) => void)[] = [];
  #scheduled = false;

  constructor(initial: T) {
    this.#state = initial;
  }

  get state(): Readonly<T> {
    return this.#state;
  }

  set(patch: Partial<T>): void {
    this.#state = { ...this.#state, ...patch };
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      for (const listener of this.#listeners) listener(this.#state);
    });
  }

  subscribe(listener: (state: T) => void): void {
    this.#listeners.push(listener);
  }
}
