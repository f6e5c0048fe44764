import type { JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { scaleOf } from "../colour/colour-map.ts";
import { Prediction } from "../model/prediction.ts";

/** Loads the skins of a solve one after the other, so that early steps are shown while later ones are computed. */
export class PredictionLoader {
  readonly #app: App;
  readonly #job: JobView;
  readonly #signal: AbortSignal;
  #queue: Promise<void> = Promise.resolve();
  #prediction: Prediction | undefined;

  constructor(app: App, job: JobView) {
    this.#app = app;
    this.#job = job;
    this.#signal = app.signal;
  }

  /** Loads a step that the service has reported. */
  step(k: number, t: number, total: number): void {
    this.#queue = this.#queue.then(() => this.#load(k, t, total));
    // `finish` reports the error; without this the browser reports it as unhandled before.
    this.#queue.catch(() => undefined);
  }

  /** Waits for the steps; loads those whose events the service no longer stores. */
  async finish(): Promise<void> {
    await this.#queue;
    const { step, steps } = await this.#app.client.job(this.#job.id);
    for (let k = (this.#prediction?.arrived ?? 0) + 1; k <= step; k += 1) await this.#load(k, k / steps, steps);
  }

  async #load(k: number, t: number, total: number): Promise<void> {
    const prediction = (this.#prediction ??= await this.#begin(total));
    const frame = await this.#app.client.frame(this.#job.id, k, prediction.vertices, this.#signal);
    // Another session or solve may be shown by now.
    if (this.#signal.aborted || this.#app.state.shownSolve !== this.#job.id) return;
    prediction.add(k, t, frame);
    const { displacementMm, errorMm } = prediction.last.frame;
    const displacement = scaleOf(displacementMm, "displacement");
    const scales = errorMm ? { displacement, error: scaleOf(errorMm, "error") } : { displacement };
    if (this.#app.state.prediction !== prediction) this.#app.display({ t: 1, blend: 1, skinOpacity: 1 });
    this.#app.set({ prediction, scales });
  }

  async #begin(total: number): Promise<Prediction> {
    const triangles = await this.#app.client.topology(this.#job.id, this.#signal);
    const vertices = triangles.reduce((largest, vertex) => Math.max(largest, vertex), 0) + 1;
    const rest = await this.#app.client.frame(this.#job.id, 0, vertices, this.#signal);
    return new Prediction(this.#job.id, total, triangles, rest);
  }
}
