import type { JobView } from "@prosopon/client";
import { expect, test } from "vitest";
import { finishedSolves, newestSolve, planFor } from "./jobs.ts";

const solve = (id: string, patch: Partial<JobView> = {}) => ({ id, kind: "solve", status: "succeeded", step: 2, ...patch }) as JobView;

test("a solve takes the plan that it names, not the newest one", () => {
  const plans = [{ id: "new" }, { id: "old" }];
  expect(planFor(solve("a", { plan: "old" }), plans)).toBe(plans[1]);
  expect(planFor(solve("a", { plan: "deleted" }), plans)).toBeUndefined();
  expect(planFor(undefined, plans)).toBe(plans[0]);
});

test("the newest solve has a skin or is on its way", () => {
  const failed = solve("c", { status: "failed", step: 0 });
  const waiting = solve("b", { status: "accepted", step: 0 });
  const field = solve("d", { kind: "field" });
  expect(newestSolve([field, failed, waiting, solve("a")])?.id).toBe("b");
  expect(finishedSolves([field, failed, waiting, solve("a")]).map(({ id }) => id)).toEqual(["a"]);
});
