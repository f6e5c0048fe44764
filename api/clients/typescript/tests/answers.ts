import { vi } from "vitest";
import { Client } from "../src/index.ts";

/** A request that the client sent. */
export interface Sent {
  url: string;
  method: string;
  headers: Record<string, string>;
  body: string | undefined;
}

/** A client without network: each request takes the next answer; an `Error` stands for a broken network. */
export function clientWith(answers: (Response | Error)[], token?: string): { client: Client; sent: Sent[] } {
  const sent: Sent[] = [];
  const fetch = vi.fn(async (url: string | URL | Request, init: RequestInit = {}) => {
    const headers = init.headers as Record<string, string>;
    sent.push({ url: String(url), method: init.method ?? "GET", headers, body: init.body as string | undefined });
    const answer = answers.shift();
    if (answer === undefined) throw new Error(`no answer is left for ${String(url)}`);
    if (answer instanceof Error) throw answer;
    return answer;
  });
  return { client: new Client({ baseUrl: "http://service", token: () => token, fetch }), sent };
}

export function json(value: unknown, status = 200): Response {
  return new Response(JSON.stringify(value), { status, headers: { "content-type": "application/json" } });
}

/** An event stream of these lines; the last piece may be a cut line. */
export function lines(...pieces: string[]): Response {
  const encoder = new TextEncoder();
  const body = new ReadableStream<Uint8Array>({
    start(controller) {
      for (const piece of pieces) controller.enqueue(encoder.encode(piece));
      controller.close();
    },
  });
  return new Response(body, { headers: { "content-type": "application/x-ndjson" } });
}

export function event(id: number, name: string, data: object): string {
  return `${JSON.stringify({ id, event: name, data })}\n`;
}
