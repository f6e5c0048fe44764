import { hasEnded, jobEvent } from "./events.ts";
import type { JobEvent } from "./events.ts";
import { readNdjson } from "./ndjson.ts";
import { expandPath } from "./paths.ts";
import { isPassing, pause } from "./transport.ts";
import type { Transport } from "./transport.ts";

/** Options of `followJob`. */
export interface FollowOptions {
  /** Number of the last event that is known; the stream starts after it. 0 when absent. */
  after?: number;
  /** Ends the stream. */
  signal?: AbortSignal | undefined;
  /** Called when the connection breaks, with the time until the next attempt, ms. */
  onInterruption?: (waitMs: number) => void;
}

/** The service sends a heartbeat every 15 s; after three missed ones the connection is given up. */
const SILENCE_MS = 45_000;
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;

/**
 * Yields a job's events until its end.
 *
 * When the connection breaks, it reconnects with the number of the last event, for as long as the service is away. After `resync`
 * events are missing: read the job's view.
 *
 * @throws Problem when the service refuses, and the signal's reason when it is aborted.
 */
export async function* followJob(transport: Transport, job: string, options: FollowOptions = {}): AsyncGenerator<JobEvent> {
  let last = options.after ?? 0;
  let waitMs = FIRST_WAIT_MS;
  for (;;) {
    try {
      for await (const event of connection(transport, job, last, options.signal)) {
        last = Math.max(last, event.id);
        waitMs = FIRST_WAIT_MS;
        yield event;
        if (event.event === "end") return;
      }
    } catch (error) {
      options.signal?.throwIfAborted();
      if (!isPassing(error) && !(error instanceof BrokenStream)) throw error;
    }
    options.onInterruption?.(waitMs);
    await pause(waitMs, options.signal);
    waitMs = Math.min(2 * waitMs, LONGEST_WAIT_MS);
  }
}

/** A stream that broke off or stayed silent. */
class BrokenStream extends Error {}

async function* connection(transport: Transport, job: string, last: number, signal?: AbortSignal): AsyncGenerator<JobEvent> {
  const control = new AbortController();
  const stop = () => control.abort(signal?.reason);
  signal?.addEventListener("abort", stop, { once: true });
  const silence = () => setTimeout(() => control.abort(new BrokenStream()), SILENCE_MS);
  let timer = silence();
  try {
    const headers = { accept: "application/x-ndjson", "last-event-id": String(last) };
    const path = expandPath("/v1/jobs/{job}/events", { job });
    const response = await transport.fetch(path, { headers, signal: control.signal });
    if (response.status === 204 || response.body === null) {
      yield await endOf(transport, job, last);
      return;
    }
    for await (const line of readNdjson(response.body)) {
      clearTimeout(timer);
      timer = silence();
      const event = jobEvent(line);
      if (event) yield event;
    }
  } catch (error) {
    // `fetch` reports a stream that broke off as a `TypeError`, and a cut line is not JSON.
    const broken = error instanceof TypeError || error instanceof SyntaxError || control.signal.aborted;
    throw broken ? new BrokenStream() : error;
  } finally {
    clearTimeout(timer);
    signal?.removeEventListener("abort", stop);
    control.abort();
  }
}

/** The end of a job whose events were all sent. */
async function endOf(transport: Transport, job: string, last: number): Promise<JobEvent> {
  const view = await transport.call("get", "/v1/jobs/{job}", { path: { job } });
  if (!hasEnded(view.status)) throw new BrokenStream();
  return { event: "end", id: last, data: view };
}
