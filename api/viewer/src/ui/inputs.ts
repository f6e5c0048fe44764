import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import type { App } from "../actions/app.ts";
import { addFiles, buildField, removeUpload, setRole } from "../actions/inputs.ts";
import { partState } from "../model/state.ts";
import type { FileRole, Upload } from "../model/state.ts";
import { megabytes, stateMark } from "./format.ts";
import { panel, valueOf } from "./panel.ts";

const ROLES: [FileRole, string][] = [
  ["ct", "CT"],
  ["skin", "Skin"],
  ["skull", "Skull"],
  ["target", "Target (skin after)"],
  ["landmarks", "Landmarks"],
];

const PARTS: [string, string][] = [
  ["ct", "CT"],
  ["skin", "Skin"],
  ["skull", "Skull"],
  ["landmarks", "Landmarks"],
  ["target", "Target"],
  ["field", "Field"],
  ["mesh", "Mesh"],
];

/** Files to upload and the state of the session's parts. */
export function inputsPanel(app: App): TemplateResult {
  const { session, uploads } = app.state;
  const body = html`
    <label class="drop">
      <input type="file" multiple class="visually-hidden" @change=${(event: Event) => choose(app, event)} />
      <strong>Drop files onto the page, or choose them here</strong>
      <span class="note">
        CT: NIfTI, NRRD, MetaImage, or DICOM images in a zip. Surfaces: STL, PLY, OBJ or VTP of skin, skull and target. Landmarks: JSON.
        Coordinates are LPS in mm.
      </span>
    </label>
    <ul class="list">${uploads.map((upload) => uploadRow(app, upload))}</ul>
    ${session ? parts(app) : nothing}
  `;
  return panel("inputs", "Inputs", body, { open: true });
}

function parts(app: App): TemplateResult {
  const { session } = app.state;
  const state = (part: string) => partState(session, part);
  const ready = state("skin") === "ready" && state("skull") === "ready";
  // A prediction builds a mesh of its own, so that nobody misses one here.
  const shown = PARTS.filter(([part]) => part !== "mesh" || state(part) !== "missing");
  const fieldButton = html`<button ?disabled=${!ready || state("field") === "building"} @click=${() => buildField(app)}>Build distance field</button>`;
  return html`
    <dl class="parts">
      ${shown.map(([part, label]) => html`<div><dt>${label}</dt><dd>${stateMark(state(part))}</dd></div>`)}
    </dl>
    ${state("field") === "ready" ? nothing : fieldButton}
    ${ready ? nothing : html`<p class="note">The field needs skin and skull, or a CT.</p>`}
  `;
}

function uploadRow(app: App, upload: Upload): TemplateResult {
  const { file, role, state, sent } = upload;
  const status = { waiting: "What is this file?", sending: `${megabytes(sent)} of ${megabytes(file.size)}`, reading: "The service reads the file…", done: "Uploaded", failed: "Refused" };
  return html`<li class="upload">
    <span class="name">${file.name}</span>
    <select aria-label="What ${file.name} is" ?disabled=${state === "sending" || state === "reading"}
      @change=${(event: Event) => setRole(app, upload.id, valueOf(event) as FileRole)}>
      ${role === undefined ? html`<option value="" selected disabled>Choose…</option>` : nothing}
      ${ROLES.map(([name, label]) => html`<option value=${name} .selected=${live(name === role)}>${label}</option>`)}
    </select>
    ${state === "sending" || state === "reading" ? nothing : html`<button class="quiet" aria-label="Remove ${file.name} from this list" @click=${() => removeUpload(app, upload.id)}>✕</button>`}
    ${state === "sending" ? html`<progress max=${file.size} value=${sent} aria-label="Upload of ${file.name}"></progress>` : nothing}
    ${state === "reading" ? html`<progress aria-label="The service reads ${file.name}"></progress>` : nothing}
    <span class="note">${status[state]}</span>
  </li>`;
}

function choose(app: App, event: Event): void {
  const input = event.target as HTMLInputElement;
  const files = [...(input.files ?? [])];
  // Choosing the same file again must cause another event.
  input.value = "";
  void addFiles(app, files);
}
