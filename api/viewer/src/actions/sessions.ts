import type { App } from "./app.ts";
import { NO_SESSION } from "../model/state.ts";
import { loadLandmarks } from "./landmarks.ts";
import { openCuts } from "./cuts.ts";
import { loadTemplates } from "./draft.ts";
import { resumeJobs } from "./jobs.ts";
import { refreshSession, showSession } from "./session-view.ts";
import { loadSurfaces } from "./surfaces.ts";

/** Sessions of one page of the list. */
const PAGE = 20;

/** Lists the sessions and opens the one of the page's address. */
export async function start(app: App): Promise<void> {
  await listSessions(app);
  const session = /^#session=([\w-]+)$/.exec(location.hash)?.[1];
  if (session !== undefined && !app.state.needsToken) await openSession(app, session);
}

/** Uses a token from now on. An open session stays open, and its jobs are followed again. */
export async function useToken(app: App, token: string): Promise<void> {
  app.set({ token, needsToken: false, problems: [] });
  if (!app.state.session) return start(app);
  await listSessions(app);
  if (await app.attempt("Open the session", () => refreshSession(app).then(() => true))) await resumeJobs(app);
}

export async function listSessions(app: App): Promise<void> {
  await app.load("List sessions", async () => {
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
  const session = await app.load("Open the session", () => app.client.session(id));
  if (!session) return;
  showSession(app, session);
  await Promise.all([loadSurfaces(app), loadLandmarks(app), openCuts(app), loadTemplates(app)]);
  await resumeJobs(app);
}
