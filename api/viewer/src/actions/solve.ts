import type { JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { referenceSolves } from "../model/jobs.ts";
import { partState } from "../model/state.ts";
import type { PlanView, Schemas } from "../model/state.ts";
import { measurePlan, planMotions } from "./cuts.ts";
import { follow, showSolve } from "./jobs.ts";
import { saveLandmarks } from "./landmarks.ts";

/** Plans the shown motions, and nothing more. */
export async function makePlan(app: App): Promise<void> {
  const plan = await app.attempt("Plan the movement", () => planMotions(app));
  if (plan) await app.load("Measure overlaps of bone", () => measurePlan(app));
}

/** Makes what is missing for a prediction (field, plan, mesh), and starts the solve. */
export async function predict(app: App): Promise<void> {
  if (app.state.landmarks?.changed) await saveLandmarks(app);
  const job = await app.attempt("Predict", async () => {
    await requireField(app);
    const plan = await planMotions(app);
    const mesh = await requireMesh(app, plan);
    return app.client.solve(sessionId(app), solveRequest(app, plan, mesh));
  });
  if (job) await showSolve(app, job);
}

function sessionId(app: App): string {
  const { session } = app.state;
  if (!session) throw new Error("Open a session first.");
  return session.id;
}

async function requireField(app: App): Promise<void> {
  if (partState(app.state.session, "field") === "ready") return;
  const running = app.state.jobs.find((job) => job.kind === "field" && partState(app.state.session, "field") === "building");
  await follow(app, running ?? (await app.client.buildField(sessionId(app))));
}

/** Builds a mesh when the form gives an edge length that the newest mesh does not have; else the solve chooses. */
async function requireMesh(app: App, plan: PlanView): Promise<JobView | undefined> {
  const edgeMm = numberOf(app.state.solve.edgeMm);
  if (edgeMm === undefined) return undefined;
  const { report, state } = await app.client.mesh(sessionId(app));
  const fits = report?.settings.edge_mm === edgeMm && report.osteotomy === plan.osteotomy;
  if (state === "ready" && fits) return undefined;
  const body = { osteotomy: plan.osteotomy ?? null, edge_mm: edgeMm };
  return follow(app, await app.client.buildMesh(sessionId(app), body));
}

function solveRequest({ state }: App, plan: PlanView, mesh: JobView | undefined): Schemas["SolveRequest"] {
  const form = state.solve;
  const body: Schemas["SolveRequest"] = { plan: plan.id };
  const steps = numberOf(form.steps);
  if (steps !== undefined) body.steps = steps;
  if (form.model !== "") body.model = form.model as Schemas["ModelName"];
  // A reference that was chosen for an earlier movement is none for this one.
  if (referenceSolves(state.jobs, plan.id).some(({ id }) => id === form.referenceJob)) body.reference_job = form.referenceJob;
  if (mesh) body.mesh = mesh.id;
  return body;
}

/** Number of a field; `undefined` when it is empty. The service judges the value. */
function numberOf(text: string): number | undefined {
  const value = text.trim() === "" ? Number.NaN : Number(text);
  return Number.isFinite(value) ? value : undefined;
}
