import { hasEnded } from "@prosopon/client";
import type { JobView } from "@prosopon/client";

/** The newest solve that has a skin or is on its way; `jobs` has the newest first. */
export function newestSolve(jobs: readonly JobView[]): JobView | undefined {
  return jobs.find((job) => job.kind === "solve" && (job.step > 0 || !hasEnded(job.status)));
}

/** Solves that have succeeded. */
export function finishedSolves(jobs: readonly JobView[]): JobView[] {
  return jobs.filter((job) => job.kind === "solve" && job.status === "succeeded");
}

/** Solves whose skins are a reference for a solve of a plan: the service compares solves of one plan only. */
export function referenceSolves(jobs: readonly JobView[], plan: string | undefined): JobView[] {
  return finishedSolves(jobs).filter((job) => plan !== undefined && job.plan === plan);
}

/** The plan that a solve follows, if it is still there; without a solve the newest. `plans` has the newest first. */
export function planFor<T extends { id: string }>(solve: JobView | undefined, plans: readonly T[]): T | undefined {
  return solve ? plans.find((plan) => plan.id === solve.plan) : plans[0];
}
