import { expect, test } from "vitest";
import { Problem, Unreachable } from "../src/index.ts";
import { clientWith, json } from "./answers.ts";

const REFUSED = {
  type: "/problems/invalid-request",
  title: "Values of the request are not allowed",
  status: 422,
  detail: "expected a text, found 5",
  request_id: "r1",
  errors: [{ pointer: "/label", detail: "expected a text, found 5" }],
};

test("an error answer keeps the words of the service", async () => {
  const { client } = clientWith([json(REFUSED, 422)]);
  const problem = await client.createSession().catch((error: unknown) => error);
  expect(problem).toBeInstanceOf(Problem);
  expect(problem).toMatchObject({
    kind: "invalid-request",
    title: REFUSED.title,
    detail: REFUSED.detail,
    faults: REFUSED.errors,
    requestId: "r1",
  });
});

test("an error answer without a document has its status line", async () => {
  const { client } = clientWith([new Response("<h1>no</h1>", { status: 400, statusText: "Bad Request" })]);
  await expect(client.sessions()).rejects.toMatchObject({ status: 400, title: "Bad Request", detail: "<h1>no</h1>" });
});

test("a request is repeated with the same key while the service is away", async () => {
  const { client, sent } = clientWith([new TypeError("network"), json({ id: "s" }, 201)], "secret");
  expect(await client.createSession({ label: "case 1" })).toEqual({ id: "s" });
  expect(sent).toHaveLength(2);
  expect(sent[0]).toMatchObject({ method: "POST", url: "http://service/v1/sessions", body: '{"label":"case 1"}' });
  expect(sent[0]?.headers["authorization"]).toBe("Bearer secret");
  expect(sent[1]?.headers["idempotency-key"]).toBe(sent[0]?.headers["idempotency-key"]);
});

test("an aborted request is not repeated", async () => {
  const { client, sent } = clientWith([new TypeError("network")]);
  const signal = AbortSignal.abort(new Error("closed"));
  await expect(client.topology("j", signal)).rejects.toThrow("closed");
  expect(sent).toHaveLength(1);
});

test("Unreachable says what to check", () => {
  expect(new Unreachable("http://service/v1").message).toContain("Check the network");
});
