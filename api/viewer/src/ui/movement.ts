import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import type { App } from "../actions/app.ts";
import { selectSegment, setMotion } from "../actions/cuts.ts";
import { makePlan } from "../actions/solve.ts";
import type { FreeField, Motion, MotionKind, Point } from "../model/motion.ts";
import { areCondylesProposed, condylesOf } from "../model/state.ts";
import type { Cut, GizmoMode, PlanView } from "../model/state.ts";
import { segmentName } from "./cuts.ts";
import { findingList } from "./findings.ts";
import { shortMm, words } from "./format.ts";
import { numberFrom, panel, valueOf } from "./panel.ts";

const MOVES: [FreeField, string][] = [["forward", "Forward, mm"], ["left", "Left, mm"], ["down", "Down, mm"]];
const TURNS: [FreeField, string][] = [
  ["pitch", "Pitch, ° (front down)"],
  ["roll", "Roll, ° (left side down)"],
  ["yaw", "Yaw, ° (front to the left)"],
];
const KINDS: [MotionKind, string][] = [
  ["rest", "stays"],
  ["free", "moves and turns"],
  ["hinge", "opens about the condyles"],
  ["autorotate", "follows the upper jaw (autorotation)"],
];
const GIZMOS: [GizmoMode, string][] = [["off", "No handles"], ["translate", "Move"], ["rotate", "Turn"]];

/** Movement of each segment, by numbers and by handles in the picture. */
export function movementPanel(app: App): TemplateResult {
  const { cut } = app.state;
  const body = cut ? editor(app, cut) : html`<p class="note">Cut the bone first.</p>`;
  return panel("movement", "Movement", body);
}

function editor(app: App, cut: Cut): TemplateResult {
  const motion = cut.motions.get(cut.selected);
  const moving = cut.view.segments.filter(({ id }) => id !== 0);
  return html`
    <div role="group" class="segmented" aria-label="Segment">
      ${moving.map((segment) => html`<button aria-pressed=${segment.id === cut.selected ? "true" : "false"} @click=${() => selectSegment(app, segment.id)}>
        <span class="swatch swatch-${segment.id % 8}" aria-hidden="true"></span>${segmentName(segment)}
      </button>`)}
    </div>
    ${motion ? motionFields(app, cut, motion) : nothing}
    <div class="row">
      <button ?disabled=${cut.plan !== undefined} @click=${() => makePlan(app)}>${cut.plan ? "Planned" : "Plan the movement"}</button>
      <span class="note">The prediction plans it, too.</span>
    </div>
    ${app.state.prediction && !cut.plan ? html`<p class="note">The face in the picture belongs to an earlier movement.</p>` : nothing}
    ${cut.plan ? planReport(cut, cut.plan) : nothing}
  `;
}

function motionFields(app: App, cut: Cut, motion: Motion): TemplateResult {
  const set = (patch: Partial<Motion>) => setMotion(app, cut.selected, { ...motion, ...patch });
  return html`
    <label>This segment
      <select @change=${(event: Event) => set({ kind: valueOf(event) as MotionKind })}>
        ${KINDS.map(([kind, label]) => html`<option value=${kind} .selected=${live(kind === motion.kind)}>${label}</option>`)}
      </select>
    </label>
    ${motion.kind === "free" || motion.kind === "rest" ? freeFields(app, motion, set) : nothing}
    ${motion.kind === "hinge" ? hingeFields(app, motion, set) : nothing}
    ${motion.kind === "autorotate" ? followsField(app, cut, motion, set) : nothing}
  `;
}

type SetMotion = (patch: Partial<Motion>) => void;

function freeFields(app: App, motion: Motion, set: SetMotion): TemplateResult {
  const field = ([name, label]: [FreeField, string], step: number) => html`<label>${label}
    <input type="number" name=${name} step=${step} .value=${live(String(motion[name]))}
      @change=${(event: Event) => set({ [name]: numberFrom(event) ?? 0, kind: "free" })} />
  </label>`;
  const { gizmo } = app.state.display;
  return html`
    <div class="fields">${MOVES.map((move) => field(move, 0.5))}</div>
    <div class="fields">${TURNS.map((turn) => field(turn, 0.5))}</div>
    ${pivotFields(app, motion, set)}
    <div role="group" class="segmented" aria-label="Handles in the picture">
      ${GIZMOS.map(([mode, label]) => html`<button aria-pressed=${mode === gizmo ? "true" : "false"} @click=${() => app.display({ gizmo: mode, t: 1 })}>${label}</button>`)}
    </div>
  `;
}

function pivotFields(app: App, motion: Motion, set: SetMotion): TemplateResult {
  const points = app.state.landmarks?.document.points ?? {};
  const cut = app.state.cut;
  const centroid = cut?.view.segments.find(({ id }) => id === cut.selected)?.centroid_mm;
  const choose = (name: string) => {
    const point = name === "centroid" ? centroid : name === "point" ? motion.pivot : points[name];
    if (point) set({ pivot: point as Point, pivotName: name });
  };
  const names = ["centroid", "point", ...Object.keys(points).sort()];
  const labels: Record<string, string> = { centroid: "centre of the segment", point: "a point" };
  return html`<label>Turns about
      <select @change=${(event: Event) => choose(valueOf(event))}>
        ${names.map((name) => html`<option value=${name} .selected=${live(name === motion.pivotName)}>${labels[name] ?? words(name)}</option>`)}
      </select>
    </label>
    ${motion.pivotName === "point" ? pivotPoint(motion, set) : nothing}`;
}

function pivotPoint(motion: Motion, set: SetMotion): TemplateResult {
  return html`<div class="fields">
    ${["x", "y", "z"].map((axis, i) => html`<label>${axis}, mm
      <input type="number" step="0.5" .value=${live(String(Math.round((motion.pivot[i] ?? 0) * 100) / 100))}
        @change=${(event: Event) => set({ pivot: motion.pivot.with(i, numberFrom(event) ?? 0) as Point })} />
    </label>`)}
  </div>`;
}

function hingeFields(app: App, motion: Motion, set: SetMotion): TemplateResult {
  const known = condylesOf(app.state.landmarks) !== undefined;
  return html`<label>Opening, °
      <input type="number" step="0.5" min="-90" max="90" .value=${live(String(motion.openDeg))}
        @change=${(event: Event) => set({ openDeg: numberFrom(event) ?? 0 })} />
    </label>
    ${known ? condylesNote(app) : html`<p class="note">Needs the landmarks condylion left and right.</p>`}`;
}

function condylesNote(app: App): TemplateResult | typeof nothing {
  if (!areCondylesProposed(app.state.landmarks)) return nothing;
  return html`<p class="note"><span class="mark proposed" aria-hidden="true">◆</span> The condyles are only proposed. Check and confirm them.</p>`;
}

function followsField(app: App, cut: Cut, motion: Motion, set: SetMotion): TemplateResult {
  const others = cut.view.segments.filter(({ id }) => id !== 0 && id !== cut.selected);
  return html`<label>Upper jaw
    <select @change=${(event: Event) => set({ follows: Number(valueOf(event)) })}>
      ${others.map((segment) => html`<option value=${segment.id} .selected=${live(segment.id === motion.follows)}>${segmentName(segment)}</option>`)}
    </select>
  </label>
  <p class="note">The picture shows it after planning.</p>
  ${condylesNote(app)}`;
}

/** Overlap of a segment with other bone at the end of its path; the service measures it after the answer to a plan. */
function overlap({ along }: PlanView["reports"][number]): string {
  const end = along.at(-1);
  return end ? `${shortMm(end.overlap_mm)} mm` : "not measured yet";
}

/** What the service found about the planned movement. */
function planReport(cut: Cut, plan: PlanView): TemplateResult {
  const name = (id: number) => segmentName(cut.view.segments.find((segment) => segment.id === id) ?? { id });
  return html`
    <table>
      <thead><tr><th scope="col">Planned</th><th scope="col">moves at most</th><th scope="col">overlap at the end</th></tr></thead>
      <tbody>
        ${plan.reports.map((report) => html`<tr>
          <th scope="row">${name(report.segment)}</th>
          <td>${shortMm(report.max_displacement_mm)} mm</td>
          <td>${overlap(report)}</td>
        </tr>`)}
      </tbody>
    </table>
    ${findingList(plan.warnings ?? [])}
  `;
}
