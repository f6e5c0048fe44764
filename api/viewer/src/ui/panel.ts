import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";

/** A panel that the reader opens and closes; the browser keeps which ones are open. */
export function panel(
  name: string,
  title: string,
  body: TemplateResult,
  { open = false, note = "" }: { open?: boolean; note?: string } = {},
): TemplateResult {
  return html`<details class="panel" data-panel=${name} ?open=${open}>
    <summary><h2>${title}</h2>${note === "" ? nothing : html`<span class="note">${note}</span>`}</summary>
    <div class="body">${body}</div>
  </details>`;
}

/** Value of the element that an event comes from. */
export function valueOf(event: Event): string {
  return (event.target as HTMLInputElement | HTMLSelectElement).value;
}

/** Number of the element that an event comes from; `undefined` when it is not a number. */
export function numberFrom(event: Event): number | undefined {
  const value = (event.target as HTMLInputElement).valueAsNumber;
  return Number.isFinite(value) ? value : undefined;
}
