import { afterAll, beforeAll, expect, test } from "vitest";
import { leFortCase, planOf } from "./case.ts";
import type { CutCase } from "./case.ts";
import { Viewer } from "./page.ts";
import { freePort, Service } from "./service.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;
/** Longer than the client repeats a request by itself. */
const OUTAGE_MS = 10_000;
/** So many that the solve still runs when its first step is seen. */
const STEPS = 16;

let service: Service;
let viewer: Viewer;
let made: CutCase;

beforeAll(async () => {
  const port = await freePort();
  service = await Service.start(`cors_origins = ["http://127.0.0.1:${port}"]`);
  made = await leFortCase(service, "phantom, outage");
  await planOf(made, [0, -6, 0]);
  viewer = await Viewer.open({ service: service.url, port, isForeign: true });
}, TEST_MS);

afterAll(async () => {
  await viewer?.close();
  await service?.close();
});

test("a page of an allowed origin writes to the service and reads from it", async () => {
  const { page } = viewer;
  await viewer.uploadPhantom("phantom, across origins");
  await page.getByRole("button", { name: "Build distance field" }).click();
  await page.locator(".parts div", { hasText: "Field" }).getByText("ready").waitFor({ timeout: JOB_MS });
  expect(await viewer.filledShare()).toBeGreaterThan(0.1);
  expect(await page.locator(".problem").count()).toBe(0);
  expect(viewer.consoleErrors).toEqual([]);
}, TEST_MS);

test("a solve is followed through a reload, and its report is at the service", async () => {
  const { page } = viewer;
  await viewer.openSession(made.session);
  await page.locator("[data-panel=cuts] td").first().waitFor({ state: "attached", timeout: JOB_MS });
  await viewer.predict(2, 8);
  await page.locator(".job", { hasText: "Prediction" }).waitFor({ timeout: JOB_MS });
  await page.reload();
  await page.locator(".job.chosen", { hasText: "succeeded" }).waitFor({ timeout: JOB_MS });
  const report = await page.getByRole("link", { name: "Report" }).getAttribute("href");
  expect(report).toMatch(new RegExp(`^${service.url}/v1/jobs/`));
  await viewer.shot("40-across-origins");
  expect(viewer.consoleErrors).toEqual([]);
}, TEST_MS);

test("a service that is away for ten seconds in the middle of a solve", async () => {
  const { page } = viewer;
  await viewer.predict(STEPS, 8);
  const id = await page.locator(".job", { hasText: "Cancel" }).getAttribute("data-job", { timeout: JOB_MS });
  const job = { id: id ?? "" };
  await viewer.job(job.id).getByText(new RegExp(`step [1-9] of ${STEPS}`)).waitFor({ timeout: JOB_MS });
  await service.kill();
  const notice = page.getByRole("status").getByText("The service does not answer. Trying again");
  await notice.waitFor({ timeout: 5000 });
  await viewer.shot("41-service-away");
  await page.waitForTimeout(OUTAGE_MS);
  expect(await notice.isVisible()).toBe(true);
  await service.start();
  await notice.waitFor({ state: "hidden", timeout: 15_000 });
  await viewer.shownJob(job.id).getByText("succeeded").waitFor({ timeout: JOB_MS });
  expect(await page.locator(".problem").count()).toBe(0);
  await expect.poll(() => page.getByText(` of ${STEPS} steps`).count(), { timeout: JOB_MS }).toBe(0);
  await viewer.shot("42-service-back");
}, TEST_MS);

test("a page that is loaded while the service is away opens its session when the service is back", async () => {
  const { page } = viewer;
  await service.kill();
  await page.reload();
  await page.getByRole("status").getByText("The service does not answer").waitFor();
  await page.waitForTimeout(OUTAGE_MS);
  await service.start();
  await page.locator(".job.chosen", { hasText: "succeeded" }).waitFor({ timeout: JOB_MS });
  expect(await page.locator(".problem").count()).toBe(0);
}, TEST_MS);
