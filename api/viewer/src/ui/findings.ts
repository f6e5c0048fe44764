import { html, nothing } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { Finding } from "@prosopon/client";

/** Warnings of the service: the finding, and what to do about it. Those that make a result unreliable come first. */
export function findingList(findings: readonly Finding[]): TemplateResult | typeof nothing {
  const shown = findings.filter(({ severity }) => severity !== "info");
  if (shown.length === 0) return nothing;
  const sorted = shown.toSorted((a, b) => Number(b.severity === "unreliable") - Number(a.severity === "unreliable"));
  return html`<ul class="findings">${sorted.map((finding) => html`<li class="finding-${finding.severity}">
    <strong>${finding.severity === "unreliable" ? "Unreliable" : "Check"}:</strong> ${finding.message}. ${finding.action ?? ""}
  </li>`)}</ul>`;
}
