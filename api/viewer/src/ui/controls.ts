import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";
import type { App } from "../actions/app.ts";
import { togglePlay } from "../actions/play.ts";
import type { ColourMode } from "../model/state.ts";
import { standardView, VIEW_NAMES } from "../scene/views.ts";
import type { ViewName } from "../scene/views.ts";
import { valueOf } from "./panel.ts";

/** Buttons of the standard views, over the picture. */
export function viewButtons(setView: (view: ViewName) => void): TemplateResult {
  return html`<div role="group" class="segmented views" aria-label="View">
    ${VIEW_NAMES.map((name) => {
      const { label, key } = standardView(name);
      return html`<button title="Key ${key}" @click=${() => setView(name)}>${label}</button>`;
    })}
  </div>`;
}

/** Sliders and choices below the picture. */
export function controls(app: App): TemplateResult {
  const { display, prediction, cut } = app.state;
  return html`<div class="controls">
    ${prediction || cut ? path(app) : nothing}
    ${prediction ? slider("Before – after", display.blend, (blend) => app.display({ blend }), ["before", "after"]) : nothing}
    ${slider("Skin", display.skinOpacity, (skinOpacity) => app.display({ skinOpacity }))}
    ${slider("Bone", display.boneOpacity, (boneOpacity) => app.display({ boneOpacity }))}
    ${prediction ? colours(app) : nothing}
    <label class="check"><input type="checkbox" .checked=${live(display.landmarks)}
      @change=${(event: Event) => app.display({ landmarks: (event.target as HTMLInputElement).checked })} />Landmarks</label>
  </div>`;
}

function path(app: App): TemplateResult {
  const { display, prediction } = app.state;
  const arrived = prediction && prediction.arrived < prediction.total ? html`<span class="note">${prediction.arrived} of ${prediction.total} steps</span>` : nothing;
  return html`<div class="path">
    <button aria-label=${display.playing ? "Pause" : "Play the path"} title="Space" @click=${() => togglePlay(app)}>${display.playing ? "❚❚" : "▶"}</button>
    ${slider("Path", display.t, (t) => app.display({ t, playing: false }))}
    ${arrived}
  </div>`;
}

function slider(label: string, value: number, set: (value: number) => void, ends?: [string, string]): TemplateResult {
  const text = ends ? `${Math.round(100 * value)} % ${ends[1]}` : `${Math.round(100 * value)} %`;
  return html`<label class="slider"><span>${label}</span>
    <input type="range" min="0" max="1" step="0.01" .value=${live(String(value))} aria-label=${label} aria-valuetext=${text}
      @input=${(event: Event) => set(Number(valueOf(event)))} />
    <output>${Math.round(100 * value)} %</output>
  </label>`;
}

function colours(app: App): TemplateResult {
  const { display, prediction, comparison } = app.state;
  const options: [ColourMode, string, boolean][] = [
    ["none", "skin", true],
    ["displacement", "displacement", true],
    ["error", prediction?.hasError ? "signed error" : "signed error: no reference", prediction?.hasError === true],
  ];
  if (comparison?.isComparable) options.push(["distance", "distance to B", true]);
  return html`<label class="choice">Colours
    <select name="colour" @change=${(event: Event) => app.display({ colour: valueOf(event) as ColourMode })}>
      ${options.map(([mode, label, usable]) => html`<option value=${mode} .selected=${live(mode === display.colour)} ?disabled=${!usable}>${label}</option>`)}
    </select>
  </label>`;
}
