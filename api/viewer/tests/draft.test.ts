import { afterAll, beforeAll, expect, test } from "vitest";
import { phantomCase } from "./case.ts";
import type { Case } from "./case.ts";
import { Viewer } from "./page.ts";
import type { HandleAxis } from "./page.ts";
import { Service } from "./service.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;

const GROUP = "Handles of the cut";
const NORMAL: HandleAxis = { group: GROUP, mode: "Move", colour: "blue", edge: "top", tip: "along the normal" };
const WIDTH: HandleAxis = { group: GROUP, mode: "Turn", colour: "green", edge: "corner", tip: "about its width" };

let service: Service;
let viewer: Viewer;
let made: Case;

beforeAll(async () => {
  service = await Service.start();
  made = await phantomCase(service, "phantom, cuts before they are made");
  viewer = await Viewer.open({ service: service.url });
}, TEST_MS);

afterAll(async () => {
  await viewer?.close();
  await service?.close();
});

test("a chosen template lists its landmarks and shows its cuts", async () => {
  const { page } = viewer;
  await viewer.openSession(made.session);
  await page.getByText("Load the").waitFor({ state: "hidden", timeout: JOB_MS });
  await page.getByRole("button", { name: "Front", exact: true }).click();
  await page.getByRole("checkbox", { name: "Landmarks" }).uncheck();
  await viewer.panel("cuts");
  const template = (label: string) => page.locator(".template", { has: page.getByLabel(label, { exact: true }) });
  expect(await template("Genioplasty").textContent()).toContain("all landmarks confirmed");
  expect(await template("Sagittal split (BSSO), left").textContent()).toContain("2 of 4 landmarks only proposed");
  await page.getByLabel("Sagittal split (BSSO), left").check();
  expect(await template("Sagittal split (BSSO), left").textContent()).toMatch(/Lingula left,\s+proposed/);
  await page.locator(".draft li").nth(4).waitFor({ timeout: JOB_MS });
  await viewer.shot("60-draft-bsso");
  const shown = await viewer.picture();
  await page.getByLabel("Sagittal split (BSSO), left").uncheck();
  await expect.poll(() => page.locator(".draft").count()).toBe(0);
  expect((await viewer.picture()).differenceTo(shown)).toBeGreaterThan(0.002);
}, TEST_MS);

test("numbers move a plane along its normal and turn it, by keyboard alone", async () => {
  const { page } = viewer;
  await page.getByLabel("Le Fort I", { exact: true }).check();
  await page.locator(".draft li").nth(2).waitFor({ timeout: JOB_MS });
  const placed = await viewer.picture();
  await page.getByLabel("Along its normal, mm").focus();
  for (let i = 0; i < 4; i += 1) await page.keyboard.press("ArrowUp");
  await page.keyboard.press("Tab");
  expect(await page.getByLabel("Along its normal, mm").inputValue()).toBe("2");
  await page.getByLabel("About its width, °").fill("6");
  await page.getByLabel("About its width, °").press("Tab");
  await page.locator(".draft li", { hasText: "moved" }).waitFor();
  expect((await viewer.picture()).differenceTo(placed)).toBeGreaterThan(0.002);
  await viewer.shot("61-draft-numbers");
  expect(await viewer.accessibilityFindings()).toEqual([]);
  await page.getByRole("button", { name: "Put it back" }).click();
  expect((await viewer.picture()).differenceTo(placed)).toBeLessThan(0.001);
}, TEST_MS);

test("handles do the same by mouse", async () => {
  const { page } = viewer;
  await viewer.dragHandle(NORMAL, [0, -20]);
  const along = Number(await page.getByLabel("Along its normal, mm").inputValue());
  expect(along).toBeGreaterThan(2);
  await viewer.dragHandle(WIDTH, [25, 25]);
  const turned = Number(await page.getByLabel("About its width, °").inputValue());
  expect(turned).toBeGreaterThan(2);
  expect(Number(await page.getByLabel("About its length, °").inputValue())).toBe(0);
  await viewer.shot("62-draft-handles");
  await page.getByRole("button", { name: "Put it back" }).click();
}, TEST_MS);

test("a plane that a move makes too short is refused with the place, and can be made longer", async () => {
  const { page } = viewer;
  await page.getByLabel("Along its normal, mm").fill("4");
  await page.getByLabel("Along its normal, mm").press("Tab");
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator(".problem", { hasText: "bridges are left" }).waitFor({ timeout: JOB_MS });
  await viewer.shot("63-draft-bridge");
  await page.getByRole("button", { name: "Dismiss this problem" }).click();
  await page.locator(".draft").getByRole("button", { name: "Pterygomaxillary" }).click();
  await expect.poll(() => page.getByLabel("Width, mm", { exact: true }).inputValue()).toBe("36");
  await page.getByLabel("Width, mm", { exact: true }).fill("48");
  await page.getByLabel("Width, mm", { exact: true }).press("Tab");
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator(".draft").waitFor({ state: "detached", timeout: JOB_MS });
  await page.locator("[data-panel=cuts] td").first().waitFor({ timeout: JOB_MS });
}, TEST_MS);

test("moved cuts are sent as cuts, others as templates", async () => {
  const { page } = viewer;
  await page.getByLabel("Le Fort I", { exact: true }).check();
  await page.locator(".draft li").nth(2).waitFor({ timeout: JOB_MS });
  await page.locator(".draft li button").first().click();
  await expect.poll(() => page.getByLabel("Width, mm", { exact: true }).inputValue()).toBe("65");
  await page.getByLabel("Along its normal, mm").fill("2");
  await page.getByLabel("Along its normal, mm").press("Tab");
  await page.getByLabel("Saw width, mm").fill("1");
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator(".draft").waitFor({ state: "detached", timeout: JOB_MS });
  await page.locator("[data-panel=cuts] .list li", { hasText: "Le Fort I, cuts moved" }).nth(1).waitFor();
  await page.locator("[data-panel=cuts] td").first().waitFor({ timeout: JOB_MS });
  await viewer.shot("64-draft-cut");
  await page.getByLabel("Le Fort I", { exact: true }).check();
  await page.locator(".draft li").nth(2).waitFor({ timeout: JOB_MS });
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator(".draft").waitFor({ state: "detached", timeout: JOB_MS });
  const [, moved, placed] = await made.client.osteotomies(made.session);
  const [z, kerf] = [(i: typeof moved) => i?.cuts[0]?.plane?.point_mm[2], (i: typeof moved) => i?.cuts[0]?.kerf_mm];
  expect(z(moved)).toBeCloseTo((z(placed) ?? 0) + 2, 6);
  expect([kerf(moved), kerf(placed)]).toEqual([1, 1]);
  expect(moved?.segments.map(({ name }) => name)).toEqual(placed?.segments.map(({ name }) => name));
  expect(placed?.templates).toEqual(["le_fort_1"]);
  // The browser notes the refused request of the test before.
  expect(viewer.consoleErrors.filter((text) => !text.includes("422"))).toEqual([]);
}, TEST_MS);
