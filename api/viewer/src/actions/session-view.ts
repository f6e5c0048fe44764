import type { App } from "./app.ts";
import type { SessionView } from "../model/state.ts";

/** Reads the open session again. */
export async function refreshSession(app: App): Promise<void> {
  const { signal } = app;
  const open = app.state.session;
  if (!open) return;
  const session = await app.client.session(open.id);
  if (!signal.aborted) showSession(app, session);
}

/** Shows a session's view, and its jobs with the newest first. */
export function showSession(app: App, session: SessionView): void {
  const sessions = app.state.sessions.map((known) => (known.id === session.id ? session : known));
  const jobs = session.jobs.toSorted((a, b) => b.created_at.localeCompare(a.created_at));
  app.set({ session, sessions, jobs });
}
