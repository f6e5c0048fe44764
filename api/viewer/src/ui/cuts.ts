import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { cutByTemplate, deleteCut, hideCut, showCut } from "../actions/cuts.ts";
import { partState } from "../model/state.ts";
import type { OsteotomyView, Schemas } from "../model/state.ts";
import { words } from "./format.ts";
import { findingList } from "./findings.ts";
import { panel } from "./panel.ts";

type TemplateName = Schemas["TemplateName"];

const TEMPLATES: [TemplateName, string][] = [
  ["le_fort_1", "Le Fort I"],
  ["le_fort_2", "Le Fort II"],
  ["le_fort_3", "Le Fort III"],
  ["bsso_left", "Sagittal split (BSSO), left"],
  ["bsso_right", "Sagittal split (BSSO), right"],
  ["genioplasty", "Genioplasty"],
  ["two_piece_maxilla", "Two-piece maxilla"],
  ["mandible", "Lower jaw, without a cut"],
];

/** Osteotomies by template, with their segments. */
export function cutsPanel(app: App): TemplateResult {
  const { session, osteotomies, cut } = app.state;
  const ready = partState(session, "skull") === "ready";
  const body = html`
    <form @submit=${(event: Event) => submit(app, event)}>
      <fieldset class="templates">
        <legend>Templates; several cut the same bone</legend>
        ${TEMPLATES.map(([name, label]) => html`<label class="check"><input type="checkbox" name="template" value=${name} />${label}</label>`)}
      </fieldset>
      <div class="row">
        <label>Saw width, mm<input type="number" name="kerf" min="0" max="10" step="0.1" value="0" /></label>
        <button class="primary" ?disabled=${!ready}>Cut the bone</button>
      </div>
    </form>
    <ul class="list">${osteotomies.map((view) => row(app, view, view.id === cut?.view.id))}</ul>
    ${cut ? segments(cut.view) : nothing}
  `;
  return panel("cuts", "Osteotomies", body, { note: osteotomies.length === 0 ? "" : String(osteotomies.length) });
}

function row(app: App, view: OsteotomyView, shown: boolean): TemplateResult {
  const name = view.label ?? (view.templates ?? []).map(label).join(" + ");
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

function label(name: string): string {
  return TEMPLATES.find(([known]) => known === name)?.[1] ?? words(name);
}

function submit(app: App, event: Event): void {
  event.preventDefault();
  const data = new FormData(event.target as HTMLFormElement);
  void cutByTemplate(app, data.getAll("template") as TemplateName[], Number(data.get("kerf")));
}
