import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import type { ShownProblem } from "../model/state.ts";

/** Problems in the words of the service, the newest first. */
export function problemList(app: App): TemplateResult {
  return html`<div class="problems" role="alert">${app.state.problems.map((problem) => card(app, problem))}</div>`;
}

function card(app: App, problem: ShownProblem): TemplateResult {
  return html`<article class="problem">
    <header>
      <h2>${problem.title}</h2>
      <button class="quiet" aria-label="Dismiss this problem" @click=${() => app.dismiss(problem.id)}>✕</button>
    </header>
    <p>${problem.detail}</p>
    ${problem.faults.length === 0 ? nothing : faults(problem)}
    <p class="note">${problem.during}${problem.requestId ? html` · request <code>${problem.requestId}</code>` : nothing}</p>
  </article>`;
}

/** A single fault repeats the detail; it is then shown once. */
function faults({ faults, detail }: ShownProblem): TemplateResult {
  return html`<ul>
    ${faults.map((fault) => html`<li><code>${fault.pointer}</code>${fault.detail === detail ? nothing : html` ${fault.detail}`}</li>`)}
  </ul>`;
}
