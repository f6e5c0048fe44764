import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { closeSession, createSession, deleteSession, listMoreSessions, openSession } from "../actions/sessions.ts";
import type { SessionView } from "../model/state.ts";
import { when } from "./format.ts";
import { panel } from "./panel.ts";

/** List of sessions; the open one can be closed or deleted. */
export function sessionsPanel(app: App): TemplateResult {
  const { session, sessions, moreSessions } = app.state;
  const body = html`
    <form class="row" @submit=${(event: Event) => create(app, event)}>
      <label class="grow">Label<input name="label" maxlength="200" placeholder="case 1" /></label>
      <button class="primary">New session</button>
    </form>
    ${sessions.length === 0 ? html`<p class="note">There are no sessions yet. Create one, or drop files onto the page.</p>` : nothing}
    <ul class="list sessions">${sessions.map((view) => row(app, view, view.id === session?.id))}</ul>
    ${moreSessions === undefined ? nothing : html`<button @click=${() => listMoreSessions(app)}>Older sessions</button>`}
  `;
  return panel("sessions", "Sessions", body, { open: true, note: session ? "" : "choose or create one" });
}

function row(app: App, view: SessionView, open: boolean): TemplateResult {
  return html`<li class=${open ? "chosen" : ""}>
    <button class="quiet grow name" aria-current=${open ? "true" : "false"} @click=${() => openSession(app, view.id)}>
      <strong>${view.label ?? "Session without a label"}</strong>
      <span class="note">${when(view.created_at)} · ${summary(view)}</span>
    </button>
    ${open ? html`<button @click=${() => closeSession(app)}>Close</button>` : nothing}
    ${open ? html`<button @click=${() => remove(app, view)}>Delete</button>` : nothing}
  </li>`;
}

/** What a session has, and what its jobs do. */
function summary(view: SessionView): string {
  const running = view.jobs.filter((job) => job.status === "running" || job.status === "accepted").length;
  const solved = view.jobs.filter((job) => job.kind === "solve" && job.status === "succeeded").length;
  const surfaces = view.parts["skin"]?.state === "ready" && view.parts["skull"]?.state === "ready";
  if (running > 0) return `${running} running`;
  if (solved > 0) return solved === 1 ? "1 prediction" : `${solved} predictions`;
  return surfaces ? "surfaces ready" : "surfaces missing";
}

function create(app: App, event: Event): void {
  event.preventDefault();
  const form = event.target as HTMLFormElement;
  const label = String(new FormData(form).get("label") ?? "").trim();
  form.reset();
  void createSession(app, label);
}

function remove(app: App, view: SessionView): void {
  if (confirm(`Delete the session “${view.label ?? view.id}” with its results? It can be restored for a day.`)) void deleteSession(app, view.id);
}
