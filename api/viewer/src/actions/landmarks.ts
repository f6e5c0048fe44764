import type { App } from "./app.ts";
import { placeDraft } from "./draft.ts";
import type { Point } from "../model/motion.ts";
import { partState } from "../model/state.ts";
import type { Landmarks } from "../model/state.ts";

/** Loads the landmarks, with proposals where skin and skull allow them. Unsaved changes are kept. */
export async function loadLandmarks(app: App): Promise<void> {
  const { session, landmarks } = app.state;
  if (!session || landmarks?.changed) return;
  const propose = partState(session, "skin") === "ready" && partState(session, "skull") === "ready";
  if (!propose && partState(session, "landmarks") === "missing") return;
  const { signal } = app;
  await app.load("Load the landmarks", async () => {
    const document = await app.client.landmarks(session.id, { propose });
    signal.throwIfAborted();
    app.set({ landmarks: { document, changed: false, selected: app.state.landmarks?.selected } });
  });
}

/** Selects a landmark. */
export function selectLandmark(app: App, name: string | undefined): void {
  change(app, { selected: name });
}

/** Moves a landmark. A moved landmark counts as confirmed. */
export function moveLandmark(app: App, name: string, point: Point): void {
  const known = app.state.landmarks;
  if (!known) return;
  const document = { ...known.document, points: { ...known.document.points, [name]: point } };
  change(app, { document: withoutProposal(document, name), changed: true, selected: name });
}

/** Accepts the proposed place of a landmark. */
export function confirmLandmark(app: App, name: string): void {
  const known = app.state.landmarks;
  if (known) change(app, { document: withoutProposal(known.document, name), changed: true });
}

/** Stores the shown landmarks; those that nobody has confirmed stay marked as proposed. */
export async function saveLandmarks(app: App): Promise<void> {
  const { session, landmarks } = app.state;
  if (!session || !landmarks) return;
  await app.attempt("Save the landmarks", async () => {
    const document = await app.client.putLandmarks(session.id, landmarks.document);
    change(app, { document, changed: false });
  });
  await placeDraft(app);
}

/** Drops unsaved changes. */
export async function revertLandmarks(app: App): Promise<void> {
  change(app, { changed: false });
  await loadLandmarks(app);
}

function change(app: App, patch: Partial<Landmarks>): void {
  const known = app.state.landmarks;
  if (known) app.set({ landmarks: { ...known, ...patch } });
}

function withoutProposal(document: Landmarks["document"], name: string): Landmarks["document"] {
  const within = { ...document.proposed_within_mm };
  delete within[name];
  const proposed = (document.proposed ?? []).filter((other) => other !== name);
  return { ...document, proposed, proposed_within_mm: within };
}
