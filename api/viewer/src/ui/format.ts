import type { TemplateResult } from "lit-html";
import { html } from "lit-html";

/** A length without needless digits, mm. */
export function shortMm(value: number): string {
  return String(Number(value.toFixed(Math.abs(value) < 0.2 ? 3 : 2))).replace("-", "−");
}

/** A length with its sign, mm. */
export function signedMm(value: number): string {
  return `${value > 0 ? "+" : ""}${shortMm(value)}`;
}

export function megabytes(bytes: number): string {
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Date and time of the reader. */
export function when(iso: string): string {
  return new Date(iso).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

/** Date and time of the reader, with seconds: it tells predictions of one minute apart. */
export function exactly(iso: string): string {
  return new Date(iso).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "medium" });
}

/** Time of day of the reader, with seconds. */
export function timeOf(iso: string): string {
  return new Date(iso).toLocaleTimeString(undefined, { timeStyle: "medium" });
}

/** Remaining time, s. */
export function remaining(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return "";
  return seconds < 90 ? `about ${Math.max(1, Math.round(seconds))} s left` : `about ${Math.round(seconds / 60)} min left`;
}

/** A name of the service in words: `condylion_left` as `Condylion left`. */
export function words(name: string): string {
  if (name === "ans") return "Anterior nasal spine";
  const spaced = name.replaceAll("_", " ");
  return spaced.charAt(0).toUpperCase() + spaced.slice(1);
}

/** State of a part or job as a word with a mark that does not depend on colour. */
export function stateMark(state: string): TemplateResult {
  const marks: Record<string, string> = { ready: "✓", succeeded: "✓", building: "…", running: "…", stale: "!", failed: "×", cancelled: "–" };
  return html`<span class="state state-${state}"><span aria-hidden="true">${marks[state] ?? "○"}</span> ${state}</span>`;
}
