import { afterAll, beforeAll, expect, test } from "vitest";
import { Viewer } from "./page.ts";
import { Service } from "./service.ts";

/** The whole journey on the phantom takes about a minute on two cores. */
const JOURNEY_MS = 300_000;
const JOB_MS = 120_000;

let service: Service;
let viewer: Viewer;

beforeAll(async () => {
  service = await Service.start();
  viewer = await Viewer.open({ service: service.url });
}, 60_000);

afterAll(async () => {
  await viewer?.close();
  await service?.close();
});

test("a Le Fort I advancement, from files to displacement", async () => {
  await upload();
  await moveLandmark();
  await cut();
  await predict();
  await play();
  await lookAtDisplacement();
  expect(viewer.consoleErrors).toEqual([]);
  expect(await viewer.accessibilityFindings()).toEqual([]);
}, JOURNEY_MS);

async function upload(): Promise<void> {
  const { page } = viewer;
  await viewer.shot("01-start");
  await viewer.uploadPhantom("phantom, Le Fort I");
  await viewer.shot("02-surfaces");
  expect(await viewer.filledShare()).toBeGreaterThan(0.1);

  await page.getByRole("button", { name: "Build distance field" }).click();
  // A field of surfaces that the service knows is ready at once.
  await page.locator(".job").waitFor();
  await viewer.shot("03-field");
  await page.locator(".parts div", { hasText: "Field" }).getByText("ready").waitFor({ timeout: JOB_MS });
}

async function moveLandmark(): Promise<void> {
  const { page } = viewer;
  await viewer.panel("landmarks");
  await page.getByRole("button", { name: "Front", exact: true }).click();
  await viewer.shot("04-landmarks-front");
  await viewer.dragLandmark("Pogonion");
  await page.getByRole("button", { name: "Save landmarks" }).click();
  await page.getByRole("button", { name: "Save landmarks", disabled: true }).waitFor();
}

async function cut(): Promise<void> {
  const { page } = viewer;
  await viewer.panel("cuts");
  await page.getByLabel("Le Fort I", { exact: true }).check();
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator("[data-panel=cuts] td").first().waitFor({ timeout: JOB_MS });
  await page.getByRole("button", { name: "Three-quarter", exact: true }).click();
  await viewer.shot("05-segments");
}

/** 6 mm forward, 2 steps on an 8 mm mesh. */
async function predict(): Promise<void> {
  const { page } = viewer;
  await viewer.panel("movement");
  await page.getByLabel("Forward, mm").fill("6");
  await page.getByLabel("Forward, mm").press("Tab");
  await page.getByRole("button", { name: "Move", exact: true }).click();
  await viewer.shot("06-movement");
  await page.getByRole("button", { name: "No handles" }).click();

  await viewer.predict(2, 8);
  await page.locator(".job", { hasText: "Prediction" }).getByText("succeeded").waitFor({ timeout: JOB_MS });
  await page.locator("select[name=colour]").waitFor({ timeout: JOB_MS });
  await viewer.shot("07-predicted");
}

async function play(): Promise<void> {
  const { page } = viewer;
  await page.getByRole("checkbox", { name: "Landmarks" }).uncheck();
  await page.getByRole("button", { name: "Play the path" }).click();
  await page.getByRole("button", { name: "Pause" }).waitFor();
  await page.getByRole("button", { name: "Play the path" }).waitFor({ timeout: 30_000 });
  expect(await viewer.slider("Path").inputValue()).toBe("1");
}

async function lookAtDisplacement(): Promise<void> {
  const { page } = viewer;
  await page.locator("select[name=colour]").selectOption("displacement");
  await page.locator(".legend").waitFor();
  await viewer.shot("08-displacement");
  await page.getByRole("button", { name: "Profile", exact: true }).click();
  await viewer.slider("Before – after").fill("0.5");
  await viewer.shot("09-profile-blend");
  await viewer.slider("Before – after").fill("1");
  await page.getByRole("button", { name: "Front", exact: true }).click();
  const box = await page.locator(".picture canvas").boundingBox();
  if (box) await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.62 * box.height);
  await page.locator(".tip", { hasText: "mm" }).waitFor();
  await viewer.shot("10-value-under-cursor");
}

test("a reload opens the session and its prediction again", async () => {
  const { page } = viewer;
  await page.reload();
  await page.locator(".path").waitFor({ timeout: JOB_MS });
  await page.locator(".job", { hasText: "Shown" }).waitFor({ timeout: JOB_MS });
  await page.emulateMedia({ colorScheme: "dark" });
  await page.locator("select[name=colour]").selectOption("displacement");
  await viewer.shot("11-dark");
  expect(await viewer.accessibilityFindings()).toEqual([]);
}, JOURNEY_MS);

test("a second model is compared with the first by its signed error", async () => {
  const { page } = viewer;
  await viewer.panel("prediction");
  await page.getByLabel("Steps").fill("2");
  await page.getByLabel("Model").selectOption("linear");
  await page.getByLabel("Signed error against").selectOption({ index: 1 });
  await page.getByRole("button", { name: "Predict the face" }).click();
  await page.locator(".job", { hasText: "succeeded" }).nth(3).waitFor({ timeout: JOB_MS });
  await page.locator("select[name=colour]").selectOption("error");
  await page.getByText("Signed error, mm").waitFor();
  await page.getByRole("button", { name: "Front", exact: true }).click();
  await viewer.shot("12-signed-error-dark");
}, JOURNEY_MS);

test("a problem is shown in the words of the service", async () => {
  const { page } = viewer;
  await viewer.panel("prediction");
  await page.getByLabel("Steps").fill("0");
  await page.getByLabel("Steps").press("Tab");
  await page.getByRole("button", { name: "Predict the face" }).click();
  await page.locator(".problem", { hasText: "/steps" }).waitFor({ timeout: JOB_MS });
  await viewer.shot("13-problem-dark");
}, JOURNEY_MS);

test("a phone's width has no horizontal scrolling", async () => {
  const { page } = viewer;
  await page.setViewportSize({ width: 390, height: 844 });
  await viewer.shot("14-phone-dark");
  await page.emulateMedia({ colorScheme: "light" });
  await viewer.shot("15-phone-light");
  expect(await page.evaluate(() => document.documentElement.scrollWidth)).toBeLessThanOrEqual(390);
  await viewer.panel("movement");
  await viewer.shot("16-phone-movement");
}, JOURNEY_MS);
