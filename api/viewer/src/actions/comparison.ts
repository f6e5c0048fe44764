import type { App } from "./app.ts";
import { mapScales } from "../colour/map-scales.ts";
import { Comparison } from "../model/comparison.ts";
import { PredictionLoader } from "./prediction.ts";
import { loadProfile } from "./profile.ts";

/** Shows a finished solve beside the shown one, and colours that one by the distance between the two skins. */
export async function compareWith(app: App, id: string): Promise<void> {
  closeComparison(app);
  const job = app.state.jobs.find((known) => known.id === id);
  if (!job) return;
  app.set({ comparedSolve: id });
  const { signal } = app;
  const loader = new PredictionLoader(app, job, () => app.state.comparedSolve === id, (second) => {
    const first = app.state.prediction;
    if (!first || second.arrived < second.total) return;
    const comparison = new Comparison(first, second);
    app.set({ comparison, scales: mapScales(first, comparison) });
    app.display({ colour: comparison.isComparable ? "distance" : app.state.display.colour, gizmo: "off" });
  });
  await app.attempt("Load the other prediction", async () => {
    for await (const event of app.client.follow(id, { signal })) loader.take(event);
    await loader.finish();
  });
  if (app.state.comparedSolve === id) void loadProfile(app, id);
}

/** Shows one prediction again. */
export function closeComparison(app: App): void {
  const { prediction, display } = app.state;
  const scales = prediction ? mapScales(prediction, undefined) : {};
  app.set({ comparedSolve: undefined, comparison: undefined, scales });
  if (display.colour === "distance") app.display({ colour: "none" });
}
