import type { App } from "./app.ts";

/** Loads the profile lines of a finished solve from its report. */
export async function loadProfile(app: App, job: string): Promise<void> {
  const { signal } = app;
  if (app.state.profiles.has(job)) return;
  await app.load("Load the profile", async () => {
    const { clinical } = await app.client.report(job, signal);
    if (signal.aborted || !clinical) return;
    app.set({ profiles: new Map(app.state.profiles).set(job, clinical) });
  });
}
