import { html, nothing, svg } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { drawProfiles, largestMovement } from "../model/profile.ts";
import type { DrawnPoint, ProfileDrawing } from "../model/profile.ts";
import type { Schemas } from "../model/state.ts";
import { shortMm } from "./format.ts";
import { panel } from "./panel.ts";

/** Size of the drawing, pixels. It fits a panel; phones shrink it. */
const WIDTH = 320;
const MAX_HEIGHT = 400;

/** Profile lines of the shown predictions, before and after, over each other. */
export function profilePanel(app: App): TemplateResult | typeof nothing {
  const { prediction, comparison, profiles } = app.state;
  const first = prediction && profiles.get(prediction.job);
  if (!first) return nothing;
  const second = comparison && profiles.get(comparison.second.job);
  const shown = second ? [first, second] : [first];
  const drawing = drawProfiles(shown.map(({ profile }) => profile), WIDTH, MAX_HEIGHT);
  const body = drawing ? figure(drawing, first, second) : html`<p class="note">The report has no profile: the skin has no line near the midline.</p>`;
  return panel("profile", "Profile", body);
}

type Clinical = Schemas["ClinicalDocument"];

function figure(drawing: ProfileDrawing, first: Clinical, second: Clinical | undefined): TemplateResult {
  const moved = shortMm(Number(largestMovement(first.profile).toFixed(1)));
  const midline = `x = ${shortMm(first.midline_x_mm)} mm${first.midline_proposed ? ", proposed; confirm the landmarks of the midline" : ""}`;
  return html`<figure class="profile">
    ${picture(drawing, `Profile before and after. Largest movement ${moved} mm.`)}
    <ul class="keys">
      <li>${sample("before")} before</li>
      <li>${sample("after-0")} ${second ? "after, A" : "after"}</li>
      ${second ? html`<li>${sample("after-1")} after, B</li>` : nothing}
    </ul>
    <figcaption class="note">The nose points to the right: the face is seen from the patient's right side, cut at the midline (${midline}).
      Grid: 10 mm. Largest movement${second ? " of A" : ""}: ${moved} mm.</figcaption>
  </figure>`;
}

function picture(drawing: ProfileDrawing, label: string): TemplateResult {
  const { width, height, columns, rows, before, after } = drawing;
  return html`<svg role="img" aria-label=${label} viewBox="0 0 ${width} ${height.toFixed(1)}" width=${width} height=${height.toFixed(1)}>
    ${columns.map((x) => svg`<line class="grid" x1=${x} x2=${x} y1="0" y2=${height}></line>`)}
    ${rows.map((y) => svg`<line class="grid" x1="0" x2=${width} y1=${y} y2=${y}></line>`)}
    ${before.map((line) => svg`<polyline class="before" points=${pointsOf(line)}></polyline>`)}
    ${after.map((lines, i) => lines.map((line) => svg`<polyline class="after-${i}" points=${pointsOf(line)}></polyline>`))}
    ${scaleBar(drawing)}
  </svg>`;
}

/** A bar of 20 mm at the lower left, where the neck leaves room behind it. */
function scaleBar({ height, pixelsPerMm }: ProfileDrawing): TemplateResult {
  const [left, right, y] = [12, 12 + 20 * pixelsPerMm, height - 14];
  return svg`<path class="scale-bar" d="M ${left} ${y - 5} v 10 M ${left} ${y} H ${right} M ${right} ${y - 5} v 10"></path>
    <text x=${(left + right) / 2} y=${y - 8}>20 mm</text>`;
}

function sample(name: string): TemplateResult {
  return html`<svg width="28" height="10" aria-hidden="true"><line class=${name} x1="0" x2="28" y1="5" y2="5"></line></svg>`;
}

function pointsOf(line: DrawnPoint[]): string {
  return line.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
}
