import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { exactly } from "./format.ts";

/** Names of two predictions side by side, over their views. */
export function captions(app: App): TemplateResult | typeof nothing {
  const { comparison, jobs } = app.state;
  if (!comparison) return nothing;
  const time = (id: string) => exactly(jobs.find((job) => job.id === id)?.created_at ?? "");
  return html`<div class="captions">
    <p><span><strong>A</strong> ${time(comparison.first.job)}</span></p>
    <p><span><strong>B</strong> ${time(comparison.second.job)}</span></p>
  </div>`;
}
