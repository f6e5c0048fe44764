import { expect, test } from "vitest";
import type { JobEvent } from "../src/index.ts";
import { clientWith, event, json, lines } from "./answers.ts";

async function all(events: AsyncIterable<JobEvent>): Promise<string[]> {
  const seen: string[] = [];
  for await (const { id, event: name } of events) seen.push(`${id} ${name}`);
  return seen;
}

test("events arrive in order, across pieces of a line, without heartbeats", async () => {
  const step = event(2, "step", { k: 1 });
  const stream = lines(event(1, "status", { status: "running" }), step.slice(0, 9), step.slice(9), '{"event":"heartbeat"}\n', event(3, "end", {}));
  const { client, sent } = clientWith([stream], "secret");
  expect(await all(client.follow("j"))).toEqual(["1 status", "2 step", "3 end"]);
  expect(sent[0]?.headers).toMatchObject({ authorization: "Bearer secret", accept: "application/x-ndjson", "last-event-id": "0" });
});

test("a broken stream continues after the last event", async () => {
  const first = lines(event(1, "status", {}), event(2, "step", { k: 1 }), '{"id":3,"ev');
  const second = lines(event(3, "step", { k: 2 }), event(4, "end", { status: "succeeded" }));
  const { client, sent } = clientWith([first, new TypeError("network"), second]);
  expect(await all(client.follow("j"))).toEqual(["1 status", "2 step", "3 step", "4 end"]);
  expect(sent.map((request) => request.headers["last-event-id"])).toEqual(["0", "2", "2"]);
});

test("a job whose events were all sent ends with its view", async () => {
  const view = { id: "j", status: "succeeded", continued_by: "k" };
  const { client } = clientWith([new Response(null, { status: 204 }), json(view)]);
  const events: JobEvent[] = [];
  for await (const next of client.follow("j", { after: 7 })) events.push(next);
  expect(events).toMatchObject([{ id: 7, event: "end", data: { status: "succeeded", continued_by: "k" } }]);
});

test("an aborted stream ends with the signal's reason", async () => {
  const control = new AbortController();
  const { client } = clientWith([lines(event(1, "status", {}))]);
  const follow = all(client.follow("j", { signal: control.signal, onInterruption: () => control.abort(new Error("closed")) }));
  await expect(follow).rejects.toThrow("closed");
});
