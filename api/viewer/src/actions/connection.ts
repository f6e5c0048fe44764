import { Problem, Unreachable } from "@prosopon/client";

/** Wait before a read is repeated for which the client has given up, ms. The client itself tries for about 8 s. */
export const REPEAT_MS = 1000;

/** Messages of browsers for an answer that breaks off: Chromium and Firefox, Safari. They throw a `TypeError`. */
const BROKEN_ANSWER = /network|fetch|load failed/i;

/**
 * Address of the service, without a slash at its end: empty for the origin of the page.
 *
 * Who serves the page from another origin writes the address into `index.html`. It is no parameter of the page's address: a link could
 * then send the token to any host.
 */
export function serviceAddress(): string {
  const meta = document.querySelector<HTMLMetaElement>("meta[name=prosopon-service]");
  return (meta?.content ?? "").trim().replace(/\/+$/, "");
}

/** Whether the service is away, or its answer broke off: the same read may succeed later. */
export function isAway(error: unknown): boolean {
  if (error instanceof Unreachable) return true;
  // A proxy in front of a service that is away answers without a problem document.
  if (error instanceof Problem) return error.status >= 500 && error.kind === "about:blank";
  return error instanceof TypeError && BROKEN_ANSWER.test(error.message);
}
