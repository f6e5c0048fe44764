import type { JobView } from "@prosopon/client";
import type { App } from "./app.ts";
import { cutDocument, isMoved } from "../model/draft.ts";
import type { Draft } from "../model/draft.ts";
import { newestSolve, planFor } from "../model/jobs.ts";
import { motionOfPath, pathRequest, restMotion } from "../model/motion.ts";
import type { Motion, Point } from "../model/motion.ts";
import { areCondylesProposed } from "../model/state.ts";
import type { Cut, OsteotomyView, PlanView, Schemas } from "../model/state.ts";
import { parsePly } from "./surfaces.ts";

/** Opacity of the skin at which new segments are seen behind it. */
export const SEE_THROUGH = 0.35;

/** Lists the osteotomies of the open session, and shows the one of its newest solve, else the newest. */
export async function openCuts(app: App): Promise<void> {
  const { session } = app.state;
  if (!session || session.osteotomies.length === 0) return;
  const { signal } = app;
  await app.load("Load the osteotomies", async () => {
    const [osteotomies, plans] = await Promise.all([app.client.osteotomies(session.id), app.client.plans(session.id)]);
    signal.throwIfAborted();
    app.set({ osteotomies: newestFirst(osteotomies) });
    const solve = newestSolve(app.state.jobs);
    const newest = app.state.osteotomies[0];
    const shown = planFor(solve, solve ? plans : newestFirst(plans).filter((plan) => plan.osteotomy === newest?.id));
    // Beside a prediction whose plan was deleted, bone at any other place would be wrong.
    if (solve && !shown) return;
    const view = shown ? app.state.osteotomies.find(({ id }) => id === shown.osteotomy) : newest;
    if (view) await showCut(app, view, shown);
    await measurePlan(app);
  });
}

/** Shows the bone as the plan of a solve moves it. Unplanned movements are dropped. */
export async function showPlanOf(app: App, job: JobView): Promise<void> {
  const { session, signal } = { session: app.state.session, signal: app.signal };
  if (!session || !job.plan || app.state.cut?.plan?.id === job.plan) return;
  await app.load("Load the plan", async () => {
    const plan = (await app.client.plans(session.id)).find(({ id }) => id === job.plan);
    const view = app.state.osteotomies.find(({ id }) => id === plan?.osteotomy);
    const cut = view && (await loadCut(app, view, plan));
    signal.throwIfAborted();
    // The user may have chosen another prediction by now.
    if (app.state.shownSolve !== job.id) return;
    if (cut) placeCut(app, cut);
    else hideCut(app);
    await measurePlan(app);
  });
}

/** Cuts the bone as the draft shows it: by its templates, or by the cuts themselves when one was moved. `label` names moved cuts. */
export async function cutDraft(app: App, kerfMm: number, label: string): Promise<void> {
  const { session, draft } = app.state;
  if (!session || !draft) return;
  await app.attempt("Cut the bone", async () => {
    const view = await app.client.createOsteotomy(session.id, osteotomyRequest(draft, kerfMm, label));
    app.set({ osteotomies: [view, ...app.state.osteotomies], draft: undefined });
    await showCut(app, view);
    if (app.state.display.skinOpacity === 1) app.display({ skinOpacity: SEE_THROUGH });
  });
}

function osteotomyRequest({ templates, cuts }: Draft, kerfMm: number, label: string): Schemas["CreateOsteotomy"] {
  if (cuts.some(isMoved)) return { label, cuts: cuts.map((cut) => cutDocument(cut, kerfMm)) };
  return { templates: templates.map((name) => (kerfMm > 0 ? { name, kerf_mm: kerfMm } : { name })) };
}

/** Shows an osteotomy: loads its segments, with the motions at rest or those of a plan. */
export async function showCut(app: App, view: OsteotomyView, plan?: PlanView): Promise<void> {
  const { signal } = app;
  const cut = await loadCut(app, view, plan);
  signal.throwIfAborted();
  placeCut(app, cut);
}

async function loadCut(app: App, view: OsteotomyView, plan: PlanView | undefined): Promise<Cut> {
  const moving = view.segments.filter(({ id }) => id !== 0);
  const motions = new Map(moving.map(({ id, centroid_mm }) => {
    const path = plan?.paths.find(({ segment }) => segment === id);
    return [id, path ? motionOfPath(path, centroid_mm as Point) : restMotion(centroid_mm as Point)];
  }));
  const { cut: shown, session } = app.state;
  if (!session) throw new Error("Open a session first.");
  if (shown?.view.id === view.id) return { ...shown, motions, plan };
  const loaded = await Promise.all(view.segments.map(async ({ id }) => {
    return [id, parsePly(await app.client.segmentPly(session.id, view.id, id, app.signal))] as const;
  }));
  return { view, surfaces: new Map(loaded), motions, plan, selected: moving[0]?.id ?? 0 };
}

function placeCut(app: App, cut: Cut): void {
  if (app.state.cut?.surfaces !== cut.surfaces) hideCut(app);
  app.set({ cut });
}

/** Shows the skull in one piece. */
export function hideCut(app: App): void {
  for (const geometry of app.state.cut?.surfaces.values() ?? []) geometry.dispose();
  app.set({ cut: undefined, display: { ...app.state.display, gizmo: "off" } });
}

export async function deleteCut(app: App, id: string): Promise<void> {
  const { session } = app.state;
  if (!session) return;
  await app.attempt("Delete the osteotomy", async () => {
    await app.client.deleteOsteotomy(session.id, id);
    if (app.state.cut?.view.id === id) hideCut(app);
    app.set({ osteotomies: app.state.osteotomies.filter((view) => view.id !== id) });
  });
}

export function selectSegment(app: App, segment: number): void {
  const { cut } = app.state;
  if (cut) app.set({ cut: { ...cut, selected: segment } });
}

/** Changes the motion of a segment; the plan made before no longer holds. */
export function setMotion(app: App, segment: number, motion: Motion): void {
  const { cut } = app.state;
  if (!cut) return;
  app.set({ cut: { ...cut, motions: new Map(cut.motions).set(segment, motion), plan: undefined } });
}

/** Reads overlaps and gaps of bone along the shown plan, unless they are known. */
export async function measurePlan(app: App): Promise<void> {
  const { session, cut } = app.state;
  if (!session || !cut?.plan || cut.plan.measured) return;
  const plan = await app.client.plan(session.id, cut.plan.id);
  const shown = app.state.cut;
  if (shown?.plan?.id === plan.id) app.set({ cut: { ...shown, plan } });
}

/** The plan of the shown motions: the one that exists, or a new one. */
export async function planMotions(app: App): Promise<PlanView> {
  const { session, cut } = app.state;
  if (!session || !cut) throw new Error("Cut the bone before planning its movement.");
  if (cut.plan) return cut.plan;
  const paths = [...cut.motions].map(([segment, motion]) => pathRequest(segment, motion)).filter((path) => path !== undefined);
  if (paths.length === 0) throw new Error("No segment moves. Give at least one segment a movement.");
  await storeCondyles(app, session.id, cut);
  const plan = await app.client.createPlan(session.id, { osteotomy: cut.view.id, paths });
  const shown = app.state.cut;
  // A change while the service planned makes this plan outdated.
  if (shown?.view.id === cut.view.id && shown.motions === cut.motions) app.set({ cut: { ...shown, plan } });
  return plan;
}

/** Stores proposed condyles, still marked as proposed: the service turns a jaw only about stored ones. */
async function storeCondyles(app: App, session: string, cut: Cut): Promise<void> {
  const turns = [...cut.motions.values()].some(({ kind }) => kind === "hinge" || kind === "autorotate");
  if (!turns || !app.state.landmarks || !areCondylesProposed(app.state.landmarks)) return;
  const document = await app.client.putLandmarks(session, app.state.landmarks.document);
  app.set({ landmarks: { ...app.state.landmarks, document, changed: false } });
}

function newestFirst<T extends { created_at: string }>(views: readonly T[]): T[] {
  return views.toSorted((a, b) => b.created_at.localeCompare(a.created_at));
}
