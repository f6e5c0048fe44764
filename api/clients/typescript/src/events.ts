import type { components } from "./openapi.ts";

type Schemas = components["schemas"];

/** A job and its current state. */
export type JobView = Schemas["JobView"];

/** A finding of the service. */
export type Finding = Schemas["WarningDocument"];

/** An event of a job with its number; heartbeats are left out. */
export type JobEvent = Exclude<Schemas["JobEventLine"], { event: "heartbeat" }>;

const KNOWN: readonly string[] = ["status", "progress", "step", "warning", "resync", "end"] satisfies JobEvent["event"][];

/** The event of a line; `undefined` for heartbeats and events of later versions. */
export function jobEvent(line: unknown): JobEvent | undefined {
  if (typeof line !== "object" || line === null || !("event" in line)) return undefined;
  return KNOWN.includes(String(line.event)) ? (line as JobEvent) : undefined;
}

/** Whether a job has ended. */
export function hasEnded(status: JobView["status"]): boolean {
  return status === "succeeded" || status === "failed" || status === "cancelled";
}
