import type { App } from "./app.ts";
import { NO_SESSION } from "../model/state.ts";
import { loadLandmarks } from "./landmarks.ts";
import { openCuts } from "./cuts.ts";
import { resumeJobs } from "./jobs.ts";
import { showSession } from "./session-view.ts";
import { loadSurfaces } from "./surfaces.ts";

/** Sessions of one page of the list. */
const PAGE = 20;

export async function listSessions(app: App): Promise<void> {
  await app.attempt("List sessions", async () => {
    const list = await app.client.sessions({ limit: PAGE });
    app.set({ sessions: list.sessions, moreSessions: list.next ?? undefined });
  });
}

export async function listMoreSessions(app: App): Promise<void> {
  const before = app.state.moreSessions;
  if (before === undefined) return;
  await app.attempt("List sessions", async () => {
    const list = await app.client.sessions({ before, limit: PAGE });
    app.set({ sessions: [...app.state.sessions, ...list.sessions], moreSessions: list.next ?? undefined });
  });
}

export async function createSession(app: App, label: string): Promise<void> {
  const session = await app.attempt("Create a session", () => app.client.createSession(label ? { label } : {}));
  if (!session) return;
  app.set({ sessions: [session, ...app.state.sessions] });
  await openSession(app, session.id);
}

export async function deleteSession(app: App, id: string): Promise<void> {
  await app.attempt("Delete the session", async () => {
    await app.client.deleteSession(id);
    if (app.state.session?.id === id) closeSession(app);
    app.set({ sessions: app.state.sessions.filter((session) => session.id !== id) });
  });
}

export function closeSession(app: App): void {
  app.newScope();
  app.set(NO_SESSION);
  history.replaceState(null, "", location.pathname + location.search);
}

/** Opens a session: its surfaces, landmarks, newest osteotomy and newest solve. Running jobs are followed again. */
export async function openSession(app: App, id: string): Promise<void> {
  app.newScope();
  app.set(NO_SESSION);
  history.replaceState(null, "", `#session=${id}`);
  const session = await app.attempt("Open the session", () => app.client.session(id));
  if (!session) return;
  showSession(app, session);
  await Promise.all([loadSurfaces(app), loadLandmarks(app), openCuts(app)]);
  await resumeJobs(app);
}
