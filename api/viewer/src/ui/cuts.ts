import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { deleteCut, hideCut, showCut } from "../actions/cuts.ts";
import type { OsteotomyView } from "../model/state.ts";
import { draftForm, templateLabel } from "./draft.ts";
import { words } from "./format.ts";
import { findingList } from "./findings.ts";
import { panel } from "./panel.ts";

/** Osteotomies by template, with their segments. */
export function cutsPanel(app: App): TemplateResult {
  const { osteotomies, cut } = app.state;
  const body = html`
    ${draftForm(app)}
    <ul class="list">${osteotomies.map((view) => row(app, view, view.id === cut?.view.id))}</ul>
    ${cut ? segments(cut.view) : nothing}
  `;
  return panel("cuts", "Osteotomies", body, { note: osteotomies.length === 0 ? "" : String(osteotomies.length) });
}

function row(app: App, view: OsteotomyView, shown: boolean): TemplateResult {
  const name = view.label ?? (view.templates ?? []).map(templateLabel).join(" + ");
  return html`<li class=${shown ? "chosen" : ""}>
    <button class="quiet grow name" aria-pressed=${shown ? "true" : "false"}
      @click=${() => (shown ? hideCut(app) : app.attempt("Load the segments", () => showCut(app, view)))}>
      ${name === "" ? "Cuts of its own" : name}
      ${view.stale ? html`<span class="note">stale: inputs have changed since</span>` : nothing}
    </button>
    <button @click=${() => deleteCut(app, view.id)}>Delete</button>
  </li>`;
}

function segments(view: OsteotomyView): TemplateResult {
  return html`
    <table>
      <thead><tr><th scope="col">Segment</th><th scope="col">cm³</th></tr></thead>
      <tbody>
        ${view.segments.map((segment) => html`<tr>
          <th scope="row"><span class="swatch swatch-${segment.id % 8}" aria-hidden="true"></span>${segmentName(segment)}${segment.id === 0 ? " (fixed)" : ""}</th>
          <td>${(segment.volume_mm3 / 1000).toFixed(1)}</td>
        </tr>`)}
      </tbody>
    </table>
    ${findingList(view.warnings ?? [])}
  `;
}

/** Name of a segment on the page. */
export function segmentName({ id, name }: { id: number; name?: string | null }): string {
  return name ? words(name) : `Segment ${id}`;
}
