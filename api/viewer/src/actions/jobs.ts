import { hasEnded, Problem } from "@prosopon/client";
import type { JobEvent, JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { newestSolve } from "../model/jobs.ts";
import { closeComparison } from "./comparison.ts";
import { openCuts, showPlanOf } from "./cuts.ts";
import { loadLandmarks } from "./landmarks.ts";
import { shownLoader } from "./prediction.ts";
import { loadProfile } from "./profile.ts";
import { refreshSession } from "./session-view.ts";
import { loadSurfaces } from "./surfaces.ts";

/** Follows the running jobs of the open session and shows its newest solve. */
export async function resumeJobs(app: App): Promise<void> {
  const running = app.state.jobs.filter((job) => !hasEnded(job.status));
  const solve = newestSolve(app.state.jobs);
  const others = running.filter((job) => job.id !== solve?.id);
  await Promise.all([solve && showSolve(app, solve), ...others.map((job) => follow(app, job))]);
}

/** Names of the kinds of jobs, as the page shows them. */
export const JOB_NAMES: Record<JobView["kind"], string> = {
  import: "Surfaces from the CT",
  field: "Distance field",
  mesh: "Tissue mesh",
  solve: "Prediction",
  compare: "Comparison",
};

/**
 * Follows a job to its end and keeps its progress in the state.
 *
 * @returns the job at its end
 * @throws the problem of a job that failed
 */
export async function follow(app: App, job: JobView, onEvent?: (event: JobEvent) => void): Promise<JobView> {
  const { signal } = app;
  putJob(app, job);
  let ended = job;
  let after = 0;
  do {
    const onInterruption = () => app.set({ interrupted: true });
    for await (const event of app.client.follow(job.id, { after, signal, onInterruption })) {
      after = Math.max(after, event.id);
      applyEvent(app, job.id, event);
      onEvent?.(event);
    }
    ended = await app.patiently(() => app.client.job(job.id));
    signal.throwIfAborted();
    putJob(app, ended);
    // A service that stops ends the stream of a job that it resumes later.
  } while (!hasEnded(ended.status));
  await app.patiently(() => refreshSession(app));
  if (ended.problem) throw new Problem(ended.problem);
  return ended;
}

/** Follows a job and then shows what it made. */
export async function followAndLoad(app: App, job: JobView): Promise<JobView | undefined> {
  return app.attempt(JOB_NAMES[job.kind], async () => {
    const ended = await follow(app, job);
    await Promise.all([loadSurfaces(app), loadLandmarks(app)]);
    if (app.state.cut === undefined) await openCuts(app);
    return ended;
  });
}

/** Shows a solve that the user has chosen, and the bone of its plan. */
export async function chooseSolve(app: App, job: JobView): Promise<void> {
  await Promise.all([showSolve(app, job), showPlanOf(app, job)]);
}

/**
 * Shows a solve: loads the steps that it has and those that arrive. When a running solve is continued by another job, that one is
 * shown next; the skin stays until the other's first step arrives.
 */
export async function showSolve(app: App, job: JobView): Promise<void> {
  closeComparison(app);
  const continues = job.continues != null && app.state.prediction?.job === job.continues;
  app.set(continues ? { shownSolve: job.id } : { shownSolve: job.id, prediction: undefined, scales: {} });
  const loader = shownLoader(app, job);
  const ended = await app.attempt(JOB_NAMES.solve, async () => {
    const ended = await follow(app, job, (event) => loader.take(event));
    await loader.finish();
    return ended;
  });
  if (ended?.status === "succeeded" && app.state.shownSolve === job.id) void loadProfile(app, job.id);
  if (ended?.continued_by && !hasEnded(job.status)) await showNext(app, job.id, ended.continued_by);
}

export async function cancelJob(app: App, id: string): Promise<void> {
  const job = await app.attempt("Cancel the job", () => app.client.cancel(id));
  if (job) putJob(app, job);
}

/** Shows the job that continues a solve; only follows it when the user shows another one by now. */
async function showNext(app: App, from: string, id: string): Promise<void> {
  const next = await app.load("Read the job that continues the prediction", () => app.client.job(id));
  if (!next) return;
  if (app.state.shownSolve === from) await showSolve(app, next);
  else await app.attempt(JOB_NAMES.solve, () => follow(app, next));
}

function applyEvent(app: App, id: string, event: JobEvent): void {
  const known = app.state.jobs.find((job) => job.id === id);
  if (!known || hasEnded(known.status)) return;
  if (event.event === "status" || event.event === "end") putJob(app, { ...known, status: event.data.status });
  if (event.event === "progress") {
    const { phase, progress, eta_s = null } = event.data;
    putJob(app, { ...known, phase, progress, eta_s });
  }
  if (event.event === "step") putJob(app, { ...known, step: event.data.k, steps: event.data.steps });
  if (event.event === "warning") putJob(app, { ...known, warnings: [...(known.warnings ?? []), event.data] });
}

function putJob(app: App, job: JobView): void {
  const others = app.state.jobs.filter((other) => other.id !== job.id);
  app.set({ jobs: [job, ...others].toSorted((a, b) => b.created_at.localeCompare(a.created_at)) });
}
