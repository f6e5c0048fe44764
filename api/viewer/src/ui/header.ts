import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import { ref } from "lit-html/directives/ref.js";
import { hasEnded } from "@prosopon/client";
import type { JobView } from "@prosopon/client";
import type { App } from "../actions/app.ts";
import { JOB_NAMES } from "../actions/jobs.ts";
import { useToken } from "../actions/sessions.ts";
import type { Theme } from "../model/state.ts";
import { remaining, words } from "./format.ts";

const THEMES: Theme[] = ["auto", "light", "dark"];

/** Title, what the page waits for, colours, and the token. */
export function header(app: App): TemplateResult {
  const { session, theme } = app.state;
  return html`<header class="top">
    <h1>Prosopon</h1>
    <p class="case">${session ? (session.label ?? "Session without a label") : nothing}</p>
    ${waiting(app)}
    <label class="compact">
      Colours
      <select @change=${(event: Event) => setTheme(app, (event.target as HTMLSelectElement).value as Theme)}>
        ${THEMES.map((name) => html`<option value=${name} .selected=${live(name === theme)}>${name}</option>`)}
      </select>
    </label>
    ${tokenField(app)}
  </header>`;
}

/** What the page waits for: a running job with its phase, or a request. */
function waiting(app: App): TemplateResult {
  const { busy, interrupted, jobs } = app.state;
  const running = jobs.find((job) => !hasEnded(job.status));
  if (interrupted) return html`<p class="waiting" role="status">The service does not answer. Trying again…</p>`;
  if (running) return jobProgress(running);
  return html`<p class="waiting" role="status">${busy.length > 0 ? `${busy.at(-1)}…` : ""}</p>`;
}

function jobProgress(job: JobView): TemplateResult {
  const name = job.continues ? `${JOB_NAMES[job.kind]} with a better setting` : JOB_NAMES[job.kind];
  const phase = job.phase === job.kind ? "" : `, ${words(job.phase).toLowerCase()}`;
  return html`<p class="waiting">${name}${phase} <progress max="1" value=${job.progress} aria-label="Progress of ${name}"></progress> ${remaining(job.eta_s)}</p>`;
}

/** Field of the token; with the cursor in it once the service has asked. */
function tokenField(app: App): TemplateResult {
  const { needsToken } = app.state;
  return html`<form class="compact ${needsToken ? "wanted" : ""}" @submit=${(event: Event) => takeToken(app, event)}>
    <label>
      ${needsToken ? "The service asks for a token" : "Token"}
      <input name="token" type="password" autocomplete="off" size="10" placeholder="none" title="Bearer token. It is kept until the page closes."
        ${ref((field) => needsToken && field && askOnce(field as HTMLInputElement))} />
    </label>
    <button>Use</button>
  </form>`;
}

/** Puts the cursor into the field at the first demand, and not at each drawing after it. */
function askOnce(field: HTMLInputElement): void {
  if (field.dataset["asked"]) return;
  field.dataset["asked"] = "yes";
  field.focus();
}

function takeToken(app: App, event: Event): void {
  event.preventDefault();
  const data = new FormData(event.target as HTMLFormElement);
  void useToken(app, String(data.get("token") ?? "").trim());
}

function setTheme(app: App, theme: Theme): void {
  app.set({ theme });
  document.documentElement.dataset["theme"] = theme;
}
