import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import type { App } from "../actions/app.ts";
import { confirmLandmark, moveLandmark, revertLandmarks, saveLandmarks, selectLandmark } from "../actions/landmarks.ts";
import type { Point } from "../model/motion.ts";
import type { Landmarks } from "../model/state.ts";
import { words } from "./format.ts";
import { numberFrom, panel } from "./panel.ts";

const AXES = ["x, to the left", "y, to the back", "z, up"];

/** Landmarks by name; the selected one can be moved by number. */
export function landmarksPanel(app: App): TemplateResult {
  const { landmarks } = app.state;
  const proposed = landmarks?.document.proposed?.length ?? 0;
  const note = proposed > 0 ? `${proposed} proposed` : "";
  const body = landmarks ? editor(app, landmarks) : html`<p class="note">Landmarks appear when skin and skull are there.</p>`;
  return panel("landmarks", "Landmarks", body, { note });
}

function editor(app: App, landmarks: Landmarks): TemplateResult {
  const names = Object.keys(landmarks.document.points).sort();
  const { selected, changed } = landmarks;
  return html`
    <p class="note">
      <span class="mark confirmed" aria-hidden="true">●</span> confirmed, <span class="mark proposed" aria-hidden="true">◆</span> proposed, with the
      expected error.
      Drag a landmark in the picture, or choose it here and change its coordinates.
    </p>
    <ul class="list landmarks" aria-label="Landmarks">${names.map((name) => row(app, landmarks, name))}</ul>
    ${selected && landmarks.document.points[selected] ? coordinates(app, landmarks, selected) : nothing}
    <div class="row">
      <button class=${changed ? "primary" : ""} ?disabled=${!changed} @click=${() => saveLandmarks(app)}>Save landmarks</button>
      <button ?disabled=${!changed} @click=${() => revertLandmarks(app)}>Drop changes</button>
    </div>
  `;
}

function row(app: App, { document, selected }: Landmarks, name: string): TemplateResult {
  const proposed = document.proposed?.includes(name) === true;
  const within = document.proposed_within_mm?.[name];
  return html`<li class=${name === selected ? "chosen" : ""}>
    <button class="quiet grow name" aria-pressed=${name === selected ? "true" : "false"} @click=${() => selectLandmark(app, name)}>
      <span class="mark ${proposed ? "proposed" : "confirmed"}" aria-hidden="true">${proposed ? "◆" : "●"}</span>
      ${words(name)}
      ${proposed ? html`<span class="note">${within === undefined ? "proposed" : `within ${within} mm`}</span>` : nothing}
    </button>
    ${proposed ? html`<button class="quiet" aria-label="Confirm ${words(name)}" @click=${() => confirmLandmark(app, name)}>Confirm</button>` : nothing}
  </li>`;
}

function coordinates(app: App, { document }: Landmarks, name: string): TemplateResult {
  const point = document.points[name] ?? [0, 0, 0];
  const change = (axis: number, event: Event) => {
    const value = numberFrom(event);
    if (value !== undefined) moveLandmark(app, name, point.with(axis, value) as Point);
  };
  return html`<fieldset>
    <legend>${words(name)}, LPS mm</legend>
    <div class="fields">
      ${AXES.map((label, axis) => html`<label>${label}
        <input type="number" step="0.1" .value=${live((point[axis] ?? 0).toFixed(2))} @change=${(event: Event) => change(axis, event)} />
      </label>`)}
    </div>
  </fieldset>`;
}
