import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import type { App } from "../actions/app.ts";
import { cutDraft } from "../actions/cuts.ts";
import { changeDraft, chooseTemplates, moveDraftCut, resetDraftCut } from "../actions/draft.ts";
import { alongNormal, displaced, displacementOf, isMovable, isMoved, isPlane, movedAlong, turned } from "../model/draft.ts";
import type { Draft, DraftCut, DraftHandle, TemplateName } from "../model/draft.ts";
import { partState } from "../model/state.ts";
import { needsOf } from "../model/template-needs.ts";
import type { Need, NeedState } from "../model/template-needs.ts";
import { findingList } from "./findings.ts";
import { words } from "./format.ts";
import { numberFrom } from "./panel.ts";

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
const HANDLES: [DraftHandle, string][] = [["off", "No handles"], ["translate", "Move"], ["rotate", "Turn"]];
const TURNS = ["About its length, °", "About its width, °", "In its plane, °"];
/** A plane that was moved may be too short for the bone there. */
const SIZES = ["Length, mm", "Width, mm"];
const MOVES: [number, string, number][] = [[1, "Forward, mm", -1], [0, "Left, mm", 1], [2, "Down, mm", -1]];
const MARKS: Record<NeedState, string> = { confirmed: "●", proposed: "◆", missing: "✕" };
/** Needs of templates that are no points. */
const VALUES: Record<string, string> = { midline_x_mm: "Midline", occlusal_plane_z_mm: "Occlusal plane", le_fort_1_plane: "Le Fort I plane" };

/** Templates with their landmarks, and the cuts that they place, which can be moved before the bone is cut. */
export function draftForm(app: App): TemplateResult {
  const { session, draft, busy } = app.state;
  const ready = partState(session, "skull") === "ready" && draft !== undefined && !busy.includes("Cut the bone");
  return html`
    <form @submit=${(event: Event) => submit(app, event)}>
      <fieldset class="templates">
        <legend>Templates; several cut the same bone</legend>
        ${TEMPLATES.map(([name, label]) => template(app, name, label))}
      </fieldset>
      ${draft ? cutsOf(app, draft) : nothing}
      <div class="row">
        <label>Saw width, mm<input type="number" name="kerf" min="0" max="10" step="0.1" value="0" /></label>
        <button class="primary" ?disabled=${!ready}>Cut the bone</button>
      </div>
    </form>`;
}

export function templateLabel(name: string): string {
  return TEMPLATES.find(([known]) => known === name)?.[1] ?? words(name);
}

function template(app: App, name: TemplateName, label: string): TemplateResult {
  const { templates, landmarks, draft, session } = app.state;
  const view = templates.find((known) => known.name === name);
  const needs = view ? needsOf(view, landmarks) : [];
  const chosen = draft?.templates.includes(name) === true;
  const note = chosen ? needList(needs, landmarks?.changed === true) : html`<span class="note">${summary(needs)}</span>`;
  const choose = (event: Event) => {
    const others = (app.state.draft?.templates ?? []).filter((other) => other !== name);
    void chooseTemplates(app, (event.target as HTMLInputElement).checked ? [...others, name] : others);
  };
  return html`<div class="template">
    <label class="check"><input type="checkbox" name="template" value=${name} .checked=${live(chosen)}
      ?disabled=${partState(session, "skull") !== "ready"} @change=${choose} />${label}</label>
    ${needs.length === 0 || !session ? nothing : note}
  </div>`;
}

/** How many of the needed landmarks are there. */
function summary(needs: Need[]): TemplateResult {
  const needed = needs.filter(({ isOptional }) => !isOptional);
  const count = (state: NeedState) => needed.filter((need) => need.state === state).length;
  const [missing, proposed] = [count("missing"), count("proposed")];
  if (missing > 0) return html`${mark("missing")} ${missing} of ${needed.length} landmarks missing`;
  if (proposed > 0) return html`${mark("proposed")} ${proposed} of ${needed.length} landmarks only proposed`;
  return html`${mark("confirmed")} all landmarks confirmed`;
}

function needList(needs: Need[], isOutdated: boolean): TemplateResult {
  const row = ({ name, state, isOptional }: Need) => html`<li>
    ${mark(state)} ${VALUES[name] ?? words(name)}<span class="note">${state === "confirmed" ? "" : `, ${state}`}${isOptional ? ", improves it" : ""}</span>
  </li>`;
  return html`<ul class="needs">${needs.map(row)}</ul>
    ${isOutdated ? html`<p class="note">Save the landmarks: the cuts stand where the saved ones put them.</p>` : nothing}`;
}

function mark(state: NeedState): TemplateResult {
  return html`<span class="mark ${state}" aria-hidden="true">${MARKS[state]}</span>`;
}

/** The cuts, and the numbers of the selected one. */
function cutsOf(app: App, draft: Draft): TemplateResult | typeof nothing {
  const cut = draft.cuts[draft.selected];
  if (!cut) return nothing;
  return html`<fieldset class="draft">
    <legend>Cuts in the picture</legend>
    <ul class="list">${draft.cuts.map((other, i) => html`<li class=${i === draft.selected ? "chosen" : ""}>
      <button type="button" class="quiet grow name" aria-pressed=${i === draft.selected ? "true" : "false"} @click=${() => changeDraft(app, { selected: i })}>
        ${templateLabel(other.original.name ?? `cut ${i + 1}`)}
        <span class="note">${other.original.purpose === "separation" ? "separates without a saw" : ""}${isMoved(other) ? " moved" : ""}</span>
      </button>
    </li>`)}</ul>
    ${isMovable(cut) ? numbers(app, draft, cut) : html`<p class="note">This one takes a part that is free already. It cannot be moved.</p>`}
    ${findingList(draft.warnings)}
  </fieldset>`;
}

function numbers(app: App, draft: Draft, cut: DraftCut): TemplateResult {
  const field = (label: string, value: number, set: (value: number) => DraftCut) => html`<label>${label}
    <input type="number" step="0.5" .value=${live(String(Number(value.toFixed(2))))} @change=${(event: Event) => moveDraftCut(app, set(numberFrom(event) ?? 0))} />
  </label>`;
  const turn = (label: string, i: number) => field(label, cut.turn[i] as number, (value) => turned(cut, i, value));
  const size = (label: string, i: number) => field(label, 2 * (cut.half?.[i] ?? 0), (value) => {
    return value > 0 && cut.half ? { ...cut, half: cut.half.with(i, value / 2) as [number, number] } : cut;
  });
  const shift = displacementOf(cut);
  return html`
    <div class="fields">${isPlane(cut)
      ? field("Along its normal, mm", alongNormal(cut), (mm) => movedAlong(cut, mm))
      : MOVES.map(([axis, label, sign]) => field(label, sign * (shift[axis] as number) + 0, (mm) => displaced(cut, axis, sign * mm)))}</div>
    ${isPlane(cut) ? html`<div class="fields">${TURNS.map(turn)}</div>` : nothing}
    ${cut.half ? html`<div class="fields">${SIZES.map(size)}</div>` : nothing}
    <div role="group" class="segmented" aria-label="Handles of the cut">
      ${HANDLES.filter(([mode]) => mode !== "rotate" || isPlane(cut)).map(([mode, label]) => html`<button type="button"
        aria-pressed=${mode === draft.handle ? "true" : "false"} @click=${() => changeDraft(app, { handle: mode })}>${label}</button>`)}
      <button type="button" ?disabled=${!isMoved(cut)} @click=${() => resetDraftCut(app)}>Put it back</button>
    </div>`;
}

function submit(app: App, event: Event): void {
  event.preventDefault();
  const { draft } = app.state;
  if (!draft) return;
  const kerfMm = Number(new FormData(event.target as HTMLFormElement).get("kerf"));
  void cutDraft(app, kerfMm, `${draft.templates.map(templateLabel).join(" + ")}, cuts moved`);
}
