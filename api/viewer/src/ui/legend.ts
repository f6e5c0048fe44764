import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { ticksOf } from "../colour/colour-map.ts";
import type { MapName } from "../colour/colour-map.ts";
import { shortMm, signedMm } from "./format.ts";

const TITLES: Record<MapName, string> = {
  displacement: "Displacement, mm",
  error: "Signed error, mm",
  distance: "Distance from A to B, of the same point of skin, mm",
};

/** Legend of the colour map, mm. */
export function legend(app: App): TemplateResult | typeof nothing {
  const { display, scales, prediction } = app.state;
  const { colour } = display;
  const scale = colour === "none" ? undefined : scales[colour];
  if (!prediction || colour === "none" || !scale) return nothing;
  const text = colour === "error" ? signedMm : shortMm;
  return html`<figure class="legend" aria-label="Legend">
    <figcaption>${TITLES[colour]}</figcaption>
    <div class="scale">
      <div class="bar bar-${colour}"></div>
      <ol>${ticksOf(scale).reverse().map((tick) => html`<li>${text(tick)}</li>`)}</ol>
    </div>
    ${colour === "error" ? html`<p class="note">+ in front of the reference<br />− behind it</p>` : nothing}
  </figure>`;
}
