import type { components } from "./openapi.ts";
import type { ProblemDocument } from "./problem.ts";

type Schemas = components["schemas"];

/** A job and its current state; `continued_by` names the job that continues it with a better setting. */
export type JobView = Schemas["JobView"] & { continued_by?: string | null };

/** A finding of the service. */
export type Finding = Schemas["WarningDocument"];

/** Data of the event `step`: the step's statistics and the links to its results. */
export type StepData = Schemas["StepDocument"] & {
  /** Number of steps of the job. */
  steps: number;
  /** `error` is present when the step has an error map. */
  links: { skin: string; frame: string; error?: string };
};

/** Data of the event `end`. */
export interface EndData {
  status: string;
  problem?: ProblemDocument | null;
  links?: Record<string, string>;
  /** Id of the job that continues this one, if one does. */
  continued_by?: string | null;
}

/** An event of a job. */
export type JobEvent =
  | { event: "status"; id: number; data: { status: string; attempt: number } }
  | { event: "progress"; id: number; data: { phase: string; progress: number; eta_s: number | null } }
  | { event: "step"; id: number; data: StepData }
  | { event: "warning"; id: number; data: Finding }
  | { event: "resync"; id: number; data: { links: Record<string, string> } }
  | { event: "end"; id: number; data: EndData };

const KNOWN: readonly string[] = ["status", "progress", "step", "warning", "resync", "end"];

/** The event of a line; `undefined` for heartbeats and events of later versions. */
export function jobEvent(line: unknown): JobEvent | undefined {
  if (typeof line !== "object" || line === null || !("event" in line)) return undefined;
  return KNOWN.includes(String(line.event)) ? (line as JobEvent) : undefined;
}

/** Whether a job has ended. */
export function hasEnded(status: string): boolean {
  return status === "succeeded" || status === "failed" || status === "cancelled";
}
