import { hasEnded, Problem } from "@prosopon/client";
import type { EndData, JobEvent, JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { openCuts } from "./cuts.ts";
import { loadLandmarks } from "./landmarks.ts";
import { PredictionLoader } from "./prediction.ts";
import { refreshSession } from "./session-view.ts";
import { loadSurfaces } from "./surfaces.ts";

/** Follows the running jobs of the open session and shows its newest solve. */
export async function resumeJobs(app: App): Promise<void> {
  const running = app.state.jobs.filter((job) => !hasEnded(job.status));
  const solve = app.state.jobs.find((job) => job.kind === "solve" && (job.step > 0 || !hasEnded(job.status)));
  const others = running.filter((job) => job.id !== solve?.id);
  await Promise.all([solve && showSolve(app, solve), ...others.map((job) => follow(app, job))]);
}

/** Names of the kinds of jobs, as the page shows them. */
export const JOB_NAMES: Record<string, string> = {
  import: "Surfaces from the CT",
  field: "Distance field",
  mesh: "Tissue mesh",
  solve: "Prediction",
  compare: "Comparison",
};

/**
 * Follows a job to its end and keeps its progress in the state.
 *
 * @returns the job at its end, or the job that continues it
 * @throws the problem of a job that failed
 */
export async function follow(app: App, job: JobView, onEvent?: (event: JobEvent) => void): Promise<JobView> {
  const { signal } = app;
  putJob(app, job);
  const onInterruption = () => app.set({ interrupted: true });
  let next: string | undefined;
  for await (const event of app.client.follow(job.id, { signal, onInterruption })) {
    if (app.state.interrupted) app.set({ interrupted: false });
    applyEvent(app, job.id, event);
    onEvent?.(event);
    if (event.event === "end") next = nextJob(event.data);
  }
  const ended = await app.client.job(job.id);
  signal.throwIfAborted();
  putJob(app, ended);
  await refreshSession(app);
  if (ended.problem) throw new Problem(ended.problem);
  next ??= ended.continued_by ?? undefined;
  return next === undefined ? ended : followNext(app, next);
}

/** Follows a job and then shows what it made. */
export async function followAndLoad(app: App, job: JobView): Promise<JobView | undefined> {
  return app.attempt(JOB_NAMES[job.kind] ?? job.kind, async () => {
    const ended = await follow(app, job);
    await Promise.all([loadSurfaces(app), loadLandmarks(app)]);
    if (app.state.cut === undefined) await openCuts(app);
    return ended;
  });
}

/** Shows a solve: loads the steps that it has and those that arrive. */
export async function showSolve(app: App, job: JobView): Promise<void> {
  const loader = new PredictionLoader(app, job);
  app.set({ shownSolve: job.id, prediction: undefined, scales: {} });
  await app.attempt(JOB_NAMES["solve"] ?? "", async () => {
    await follow(app, job, (event) => {
      if (event.event === "step") loader.step(event.data.k, event.data.t, event.data.steps);
    });
    await loader.finish();
  });
}

export async function cancelJob(app: App, id: string): Promise<void> {
  const job = await app.attempt("Cancel the job", () => app.client.cancel(id));
  if (job) putJob(app, job);
}

async function followNext(app: App, id: string): Promise<JobView> {
  const job = await app.client.job(id);
  if (job.kind === "solve") {
    await showSolve(app, job);
    return job;
  }
  return follow(app, job);
}

function nextJob(end: EndData): string | undefined {
  return end.continued_by ?? undefined;
}

function applyEvent(app: App, id: string, event: JobEvent): void {
  const known = app.state.jobs.find((job) => job.id === id);
  if (!known || hasEnded(known.status)) return;
  if (event.event === "status" || event.event === "end") putJob(app, { ...known, status: event.data.status as JobView["status"] });
  if (event.event === "progress") {
    const { phase, progress, eta_s } = event.data;
    putJob(app, { ...known, phase: phase as JobView["phase"], progress, eta_s });
  }
  if (event.event === "step") putJob(app, { ...known, step: event.data.k, steps: event.data.steps });
  if (event.event === "warning") putJob(app, { ...known, warnings: [...(known.warnings ?? []), event.data] });
}

function putJob(app: App, job: JobView): void {
  const others = app.state.jobs.filter((other) => other.id !== job.id);
  app.set({ jobs: [job, ...others].toSorted((a, b) => b.created_at.localeCompare(a.created_at)) });
}
