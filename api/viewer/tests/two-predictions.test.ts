import { afterAll, beforeAll, expect, test } from "vitest";
import type { JobView } from "@prosopon/client";
import { openAsBlob } from "node:fs";
import { join } from "node:path";
import { leFortCase, planOf } from "./case.ts";
import { PHANTOM, Viewer } from "./page.ts";
import { Service } from "./service.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;

let service: Service;
let viewer: Viewer;
let session: string;
/** Solves of two plans: 6 mm forward, then 3 mm forward and 4 mm up. */
let forward: JobView;
let upward: JobView;

beforeAll(async () => {
  service = await Service.start();
  const made = await leFortCase(service, "phantom, two plans");
  ({ session } = made);
  const { client } = made;
  // The face before is the target: errors are as large as the movement.
  await client.putSurface(session, "target", await openAsBlob(join(PHANTOM, "skin.stl")));
  const [first, second] = [await planOf(made, [0, -6, 0]), await planOf(made, [0, -3, 4])];
  // The plan made last is solved first, so that neither order gives the right pairs.
  upward = await client.finished((await client.solve(session, { plan: second, steps: 1 })).id);
  forward = await client.finished((await client.solve(session, { plan: first, steps: 1 })).id);
  viewer = await Viewer.open({ service: service.url, hasTouch: true });
}, TEST_MS);

afterAll(async () => {
  await viewer?.close();
  await service?.close();
});

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

test("a tap shows the value at a point, of displacement and of signed error", async () => {
  const { page } = viewer;
  await viewer.shownJob(forward.id).waitFor({ timeout: JOB_MS });
  await page.getByRole("button", { name: "Front", exact: true }).click();
  const box = await page.locator(".picture canvas").boundingBox();
  const tip = page.locator(".tip");
  await page.getByRole("checkbox", { name: "Landmarks" }).uncheck();
  for (const [colour, words] of [["displacement", /^[\d.]+ mm$/], ["error", /^([+−]?[\d.]+ mm|no value)$/]] as const) {
    await page.locator("select[name=colour]").selectOption(colour);
    await page.waitForTimeout(300);
    if (box) await page.touchscreen.tap(box.x + 0.5 * box.width, box.y + 0.66 * box.height);
    await tip.filter({ hasText: words }).waitFor();
    await viewer.shot(`19-tap-${colour}`);
  }
  await page.locator("select[name=colour]").selectOption("none");
  await page.getByRole("checkbox", { name: "Landmarks" }).check();
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
