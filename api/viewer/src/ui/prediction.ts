import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import { hasEnded } from "@prosopon/client";
import type { JobView } from "@prosopon/client";
import type { App } from "../actions/app.ts";
import { closeComparison, compareWith } from "../actions/comparison.ts";
import { cancelJob, chooseSolve, JOB_NAMES } from "../actions/jobs.ts";
import { openReport } from "../actions/report.ts";
import { predict } from "../actions/solve.ts";
import { finishedSolves, referenceSolves } from "../model/jobs.ts";
import type { SolveForm } from "../model/state.ts";
import { findingList } from "./findings.ts";
import { exactly, remaining, shortMm, stateMark, timeOf, words } from "./format.ts";
import { panel, valueOf } from "./panel.ts";

const MODELS: [string, string][] = [
  ["", "default"],
  ["nonlinear", "nonlinear"],
  ["mixed", "mixed"],
  ["mass_tensor", "mass tensor"],
  ["linear", "linear"],
];

/** Settings of the next solve. */
export function predictionPanel(app: App): TemplateResult {
  const { solve, cut, busy } = app.state;
  const set = (patch: Partial<SolveForm>) => app.set({ solve: { ...app.state.solve, ...patch } });
  const body = html`
    <div class="fields">
      <label>Steps<input name="steps" type="number" min="1" step="1" placeholder="default" .value=${solve.steps} @change=${(event: Event) => set({ steps: valueOf(event) })} /></label>
      <label>Edge length, mm<input name="edge" type="number" min="1" step="0.5" placeholder="default" .value=${solve.edgeMm} @change=${(event: Event) => set({ edgeMm: valueOf(event) })} /></label>
      <label>Model
        <select @change=${(event: Event) => set({ model: valueOf(event) })}>
          ${MODELS.map(([name, label]) => html`<option value=${name} .selected=${live(name === solve.model)}>${label}</option>`)}
        </select>
      </label>
    </div>
    ${referenceField(app, set)}
    <button class="primary" ?disabled=${!cut || busy.includes("Predict")} @click=${() => predict(app)}>Predict the face</button>
    <p class="note">Builds the distance field, the plan and the tissue mesh where they are missing. Not a medical device.</p>
    ${comparisonFields(app)}
  `;
  return panel("prediction", "Prediction", body);
}

function referenceField(app: App, set: (patch: Partial<SolveForm>) => void): TemplateResult | typeof nothing {
  const solves = referenceSolves(app.state.jobs, app.state.cut?.plan?.id);
  if (solves.length === 0) return nothing;
  return html`<label>Signed error against
    <select @change=${(event: Event) => set({ referenceJob: valueOf(event) })}>
      <option value="" .selected=${live(app.state.solve.referenceJob === "")}>the target, if there is one</option>
      ${solves.map((job) => html`<option value=${job.id} .selected=${live(job.id === app.state.solve.referenceJob)}>prediction of ${exactly(job.created_at)}</option>`)}
    </select>
  </label>`;
}

/** Choice of a second prediction, shown beside the first. */
function comparisonFields(app: App): TemplateResult | typeof nothing {
  const { prediction, comparedSolve, jobs } = app.state;
  const others = finishedSolves(jobs).filter((job) => job.id !== prediction?.job);
  if (!prediction || others.length === 0) return nothing;
  const choose = (id: string) => (id === "" ? closeComparison(app) : void compareWith(app, id));
  return html`<label>Compare the shown prediction with
      <select name="compare" @change=${(event: Event) => choose(valueOf(event))}>
        <option value="" .selected=${live(comparedSolve === undefined)}>none</option>
        ${others.map((job) => html`<option value=${job.id} .selected=${live(job.id === comparedSolve)}>prediction of ${exactly(job.created_at)}</option>`)}
      </select>
    </label>
    ${distanceNote(app)}`;
}

/** Distance between the two predictions at the end of their paths. */
function distanceNote(app: App): TemplateResult | typeof nothing {
  const { comparison } = app.state;
  if (!comparison) return nothing;
  const largest = comparison.largestMm;
  if (largest === undefined) return html`<p class="note">The two skins have different triangles, so that their distance is not known. Compare predictions of the same skin.</p>`;
  return html`<p class="note distance">A is the shown prediction, B the other one. At the end of the path they differ by ${shortMm(largest)} mm at most.</p>`;
}

/** Jobs of the session with progress, warnings and results. */
export function jobsPanel(app: App): TemplateResult {
  const { jobs } = app.state;
  const running = jobs.filter((job) => !hasEnded(job.status)).length;
  const body = jobs.length === 0
    ? html`<p class="note">No jobs yet.</p>`
    : html`<ul class="list jobs">${jobs.map((job) => row(app, job))}</ul>`;
  return panel("jobs", "Jobs", body, { open: true, note: running > 0 ? `${running} running` : "" });
}

function row(app: App, job: JobView): TemplateResult {
  const shown = app.state.prediction?.job === job.id;
  const name = JOB_NAMES[job.kind];
  return html`<li class="job ${shown ? "chosen" : ""}" data-job=${job.id}>
    <div class="row">
      <strong class="grow">${name}</strong>
      ${hasEnded(job.status) ? stateMark(job.status) : html`<button @click=${() => cancelJob(app, job.id)}>Cancel</button>`}
    </div>
    ${hasEnded(job.status) ? nothing : progress(job, name)}
    ${continuation(app, job)}
    ${job.problem ? html`<p class="refused">${job.problem.title}: ${job.problem.detail}</p>` : nothing}
    ${findingList(job.warnings ?? [])}
    ${job.kind === "solve" ? results(app, job, shown) : nothing}
  </li>`;
}

/** Which job continues a job, or which one it continues. */
function continuation(app: App, job: JobView): TemplateResult | typeof nothing {
  const time = (id: string) => {
    const other = app.state.jobs.find((known) => known.id === id);
    return other && timeOf(other.created_at);
  };
  if (job.continued_by) return html`<p class="note">Missed its budget; continued at ${time(job.continued_by) ?? "a later time"}.</p>`;
  if (job.continues) return html`<p class="note">Continues ${time(job.continues) ?? "an earlier one"} with a better setting.</p>`;
  return nothing;
}

function progress(job: JobView, name: string): TemplateResult {
  const queue = job.queue_position ? `, ${job.queue_position} before it` : "";
  const steps = job.kind === "solve" && job.steps > 0 ? ` · step ${job.step} of ${job.steps}` : "";
  return html`<progress max="1" value=${job.progress} aria-label="Progress of ${name}"></progress>
    <span class="note">${words(job.phase)}${queue}${steps} ${remaining(job.eta_s)}</span>`;
}

function results(app: App, job: JobView, shown: boolean): TemplateResult | typeof nothing {
  if (job.step === 0 && hasEnded(job.status)) return nothing;
  const report = app.state.token
    ? html`<button @click=${() => openReport(app, job.id)}>Report</button>`
    : html`<a class="button" href=${app.client.reportUrl(job.id)} target="_blank" rel="noopener">Report</a>`;
  return html`<div class="row">
    <button aria-pressed=${shown ? "true" : "false"} ?disabled=${shown} @click=${() => chooseSolve(app, job)}>${shown ? "Shown" : "Show"}</button>
    ${job.status === "succeeded" ? report : nothing}
    <span class="note">${exactly(job.created_at)}</span>
  </div>`;
}
