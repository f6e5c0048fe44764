import type { TemplateView } from "./draft.ts";
import type { Landmarks } from "./state.ts";

/** Whether a landmark that a template needs is there. */
export type NeedState = "confirmed" | "proposed" | "missing";

export interface Need {
  name: string;
  state: NeedState;
  /** Whether the template works without it. */
  isOptional: boolean;
}

/** The landmarks of a template, and what is known of them. */
export function needsOf(template: TemplateView, landmarks: Landmarks | undefined): Need[] {
  const need = (name: string, isOptional: boolean): Need => ({ name, isOptional, state: stateOf(name, landmarks?.document) });
  return [...template.needs.map((name) => need(name, false)), ...template.improved_by.map((name) => need(name, true))];
}

function stateOf(name: string, document: Landmarks["document"] | undefined): NeedState {
  if (!document) return "missing";
  const values = document as unknown as Record<string, unknown>;
  if (document.points[name] === undefined && (values[name] === undefined || values[name] === null)) return "missing";
  return document.proposed?.includes(name) === true ? "proposed" : "confirmed";
}
