import { expect, test } from "vitest";
import { expandPath } from "../src/paths.ts";

test("names in braces are filled and escaped", () => {
  expect(expandPath("/v1/jobs/{job}/steps/{k}/frame", { job: "a/b", k: 2 })).toBe("/v1/jobs/a%2Fb/steps/2/frame");
  expect(expandPath("/v1/jobs", {}, { limit: 3, before: undefined, session: null })).toBe("/v1/jobs?limit=3");
  expect(() => expandPath("/v1/jobs/{job}", {})).toThrow("needs a value for job");
});
