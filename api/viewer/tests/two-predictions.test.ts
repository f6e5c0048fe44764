import { afterAll, beforeAll, expect, test } from "vitest";
import { openAsBlob } from "node:fs";
import { join } from "node:path";
import { Client } from "@prosopon/client";
import type { JobView } from "@prosopon/client";
import { PHANTOM, Viewer } from "./page.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;

const client = new Client({ baseUrl: process.env["VIEWER_SERVICE"] ?? "http://127.0.0.1:8080" });
let viewer: Viewer;
let session: string;
/** Solves of two plans: 6 mm forward, then 3 mm forward and 4 mm up. */
let forward: JobView;
let upward: JobView;

beforeAll(async () => {
  ({ id: session } = await client.createSession({ label: "phantom, two plans" }));
  for (const part of ["skin", "skull"] as const) {
    await client.putSurface(session, part, await openAsBlob(join(PHANTOM, `${part}.stl`)));
  }
  await client.putLandmarks(session, JSON.parse(await (await openAsBlob(join(PHANTOM, "landmarks.json"))).text()));
  await client.finished((await client.buildField(session)).id);
  const { id: osteotomy } = await client.createOsteotomy(session, { templates: [{ name: "le_fort_1" }] });
  await client.finished((await client.buildMesh(session, { osteotomy, edge_mm: 8 })).id);
  const plans = [];
  for (const translation_mm of [[0, -6, 0], [0, -3, 4]]) {
    plans.push(await client.createPlan(session, { osteotomy, paths: [{ segment: 1, waypoints: [{ t: 1, translation_mm }] }] }));
  }
  const [first, second] = plans.map(({ id }) => id) as [string, string];
  // The plan made last is solved first, so that neither order gives the right pairs.
  upward = await client.finished((await client.solve(session, { plan: second, steps: 1 })).id);
  forward = await client.finished((await client.solve(session, { plan: first, steps: 1 })).id);
  viewer = await Viewer.open();
}, TEST_MS);

afterAll(() => viewer?.close());

test("the bone moves by the plan of the shown solve", async () => {
  const { page } = viewer;
  await viewer.openSession(session);
  await viewer.shownJob(forward.id).waitFor({ timeout: JOB_MS });
  await viewer.panel("movement");
  expect(await viewer.movement()).toEqual({ forward: "6", down: "0" });
  await viewer.job(upward.id).getByRole("button", { name: "Show" }).click();
  await viewer.shownJob(upward.id).waitFor({ timeout: JOB_MS });
  await expect.poll(() => viewer.movement()).toEqual({ forward: "3", down: "-4" });
  await viewer.job(forward.id).getByRole("button", { name: "Show" }).click();
  await expect.poll(() => viewer.movement()).toEqual({ forward: "6", down: "0" });
  expect(await page.locator(".problem").count()).toBe(0);
}, TEST_MS);

test("two solves stand side by side with their distance, by keyboard alone", async () => {
  const { page } = viewer;
  await viewer.shownJob(forward.id).waitFor({ timeout: JOB_MS });
  await viewer.panel("prediction");
  await page.locator("select[name=compare]").focus();
  await page.keyboard.press("ArrowDown");
  await page.locator(".captions").waitFor({ timeout: JOB_MS });
  await page.locator(".legend", { hasText: "Distance from A to B" }).waitFor();
  // Both plans differ by 5 mm; skin moves less than bone.
  const largest = Number(/by ([\d.]+) mm/.exec((await page.locator(".distance").textContent()) ?? "")?.[1]);
  expect(largest).toBeGreaterThan(1);
  expect(largest).toBeLessThan(5);

  await page.locator(".picture canvas").focus();
  await page.keyboard.press("1");
  await page.getByRole("checkbox", { name: "Landmarks" }).uncheck();
  const box = await page.locator(".picture canvas").boundingBox();
  if (box) await page.mouse.move(box.x + 0.25 * box.width, box.y + 0.68 * box.height);
  await page.locator(".tip", { hasText: "mm" }).waitFor();
  await viewer.shot("20-distance");
  expect(await viewer.filledShare()).toBeGreaterThan(0.1);
  expect(await viewer.accessibilityFindings()).toEqual([]);
}, TEST_MS);

test("the profile shows the lines of both solves", async () => {
  const { page } = viewer;
  await viewer.panel("profile");
  await page.getByText("after, B").waitFor({ timeout: JOB_MS });
  for (const line of ["before", "after-0", "after-1"]) expect(await page.locator(`.profile polyline.${line}`).count()).toBeGreaterThan(0);
  expect(await page.locator(".profile figcaption").textContent()).toContain("The nose points to the right");
  await viewer.shot("21-profile");
  await page.emulateMedia({ colorScheme: "dark" });
  await viewer.shot("22-profile-dark");
  expect(await viewer.accessibilityFindings()).toEqual([]);
}, TEST_MS);

test("on a phone the two views stand one below the other", async () => {
  const { page } = viewer;
  await page.setViewportSize({ width: 390, height: 844 });
  await page.evaluate(() => scrollTo(0, 0));
  await viewer.shot("23-phone-distance-dark");
  const [a, b] = await page.locator(".captions p").all();
  const [first, second] = [await a?.boundingBox(), await b?.boundingBox()];
  expect(second?.y).toBeGreaterThanOrEqual((first?.y ?? 0) + (first?.height ?? 0));
  expect(await page.evaluate(() => document.documentElement.scrollWidth)).toBeLessThanOrEqual(390);
  await page.locator("select[name=compare]").selectOption("");
  expect(await page.locator(".captions").count()).toBe(0);
  await page.setViewportSize({ width: 1280, height: 860 });
}, TEST_MS);

test("a solve that misses its budget is followed by the job that continues it", async () => {
  await viewer.pretendContinuation(session, upward.id, forward.id);
  await viewer.openSession(session);
  await viewer.shownJob(forward.id).waitFor({ timeout: JOB_MS });
  await viewer.job(upward.id).getByText(/^Missed its budget; continued at [\d:]+.*\.$/).waitFor();
  await viewer.job(forward.id).getByText(/^Continues [\d:]+.* with a better setting\.$/).waitFor();
  await viewer.job(forward.id).scrollIntoViewIfNeeded();
  await viewer.shot("24-continued-dark");
  expect(viewer.consoleErrors).toEqual([]);
}, TEST_MS);
