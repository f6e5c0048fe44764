import type { App } from "./app.ts";
import { draftCut, mergedCuts } from "../model/draft.ts";
import type { Draft, DraftCut, TemplateName } from "../model/draft.ts";
import { SEE_THROUGH } from "./cuts.ts";

/** Reads which landmarks each template needs. */
export async function loadTemplates(app: App): Promise<void> {
  if (app.state.templates.length > 0) return;
  await app.load("List the templates", async () => {
    app.set({ templates: (await app.client.transport.call("get", "/v1/templates")).templates });
  });
}

/** Chooses templates and shows where the service would cut. Cuts that were moved stay moved. */
export async function chooseTemplates(app: App, templates: TemplateName[]): Promise<void> {
  const { draft } = app.state;
  if (templates.length === 0) return dropDraft(app);
  const kept = draft ?? { cuts: [], warnings: [], selected: 0, handle: "translate" as const };
  app.set({ draft: { ...kept, templates } });
  if (!draft && app.state.display.skinOpacity === 1) app.display({ skinOpacity: SEE_THROUGH });
  await placeDraft(app);
}

/** Asks the service again where the chosen templates cut; landmarks may have changed. */
export async function placeDraft(app: App): Promise<void> {
  const { session, draft, signal } = { ...app.state, signal: app.signal };
  if (!session || !draft) return;
  const { templates } = draft;
  const preview = await app.load("Place the cuts", () => {
    const input = { path: { session: session.id }, body: { templates: templates.map((name) => ({ name })) }, signal };
    return app.client.transport.call("post", "/v1/sessions/{session}/osteotomies/preview", input);
  });
  const now = app.state.draft;
  // The user may have chosen other templates by now; their own answer follows.
  if (!now || now.templates !== templates) return;
  const cuts = preview ? mergedCuts(now.cuts, preview.cuts) : [];
  const selected = Math.min(now.selected, Math.max(cuts.length - 1, 0));
  app.set({ draft: { ...now, cuts, warnings: preview?.warnings ?? [], selected } });
}

export function dropDraft(app: App): void {
  app.set({ draft: undefined });
}

export function changeDraft(app: App, patch: Partial<Draft>): void {
  const { draft } = app.state;
  if (draft) app.set({ draft: { ...draft, ...patch } });
}

/** Puts a cut somewhere else. It is found by its original: another one may be selected by now. */
export function moveDraftCut(app: App, cut: DraftCut): void {
  const { draft } = app.state;
  if (draft) changeDraft(app, { cuts: draft.cuts.map((known) => (known.original === cut.original ? cut : known)) });
}

/** Puts the selected cut back to where the template places it. */
export function resetDraftCut(app: App): void {
  const { draft } = app.state;
  const cut = draft?.cuts[draft.selected];
  if (cut) moveDraftCut(app, draftCut(cut.original));
}
