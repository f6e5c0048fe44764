import type { JobEvent, JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { mapScales } from "../colour/map-scales.ts";
import { Prediction } from "../model/prediction.ts";

/** Loads the skins of a solve one after the other, so that early steps are shown while later ones are computed. */
export class PredictionLoader {
  readonly #app: App;
  readonly #job: JobView;
  readonly #signal: AbortSignal;
  readonly #isWanted: () => boolean;
  readonly #show: (prediction: Prediction) => void;
  #queue: Promise<void> = Promise.resolve();
  #prediction: Prediction | undefined;

  /** `show` is called with each step that arrives while `isWanted`. */
  constructor(app: App, job: JobView, isWanted: () => boolean, show: (prediction: Prediction) => void) {
    this.#app = app;
    this.#job = job;
    this.#signal = app.signal;
    this.#isWanted = isWanted;
    this.#show = show;
  }

  /** Loads the step that an event reports. */
  take(event: JobEvent): void {
    if (event.event !== "step") return;
    const { k, t, steps } = event.data;
    this.#queue = this.#queue.then(() => this.#app.patiently(() => this.#load(k, t, steps)));
    // `finish` reports the error; without this the browser reports it as unhandled before.
    this.#queue.catch(() => undefined);
  }

  /** Waits for the steps; loads those whose events the service no longer stores. */
  async finish(): Promise<void> {
    await this.#queue;
    const { step, steps } = await this.#app.patiently(() => this.#app.client.job(this.#job.id));
    for (let k = (this.#prediction?.arrived ?? 0) + 1; k <= step; k += 1) {
      await this.#app.patiently(() => this.#load(k, k / steps, steps));
    }
  }

  async #load(k: number, t: number, total: number): Promise<void> {
    if (!this.#isWanted()) return;
    const prediction = (this.#prediction ??= await this.#begin(total));
    const frame = await this.#app.client.frame(this.#job.id, k, prediction.vertices, this.#signal);
    // Another session or solve may be shown by now.
    if (this.#signal.aborted || !this.#isWanted()) return;
    prediction.add(k, t, frame);
    this.#show(prediction);
  }

  async #begin(total: number): Promise<Prediction> {
    const triangles = await this.#app.client.topology(this.#job.id, this.#signal);
    const vertices = triangles.reduce((largest, vertex) => Math.max(largest, vertex), 0) + 1;
    const rest = await this.#app.client.frame(this.#job.id, 0, vertices, this.#signal);
    return new Prediction(this.#job.id, total, triangles, rest);
  }
}

/** Loader of the shown solve. */
export function shownLoader(app: App, job: JobView): PredictionLoader {
  const isWanted = () => app.state.shownSolve === job.id;
  return new PredictionLoader(app, job, isWanted, (prediction) => {
    if (app.state.prediction !== prediction) app.display({ t: 1, blend: 1, skinOpacity: 1 });
    app.set({ prediction, scales: mapScales(prediction, app.state.comparison) });
  });
}
