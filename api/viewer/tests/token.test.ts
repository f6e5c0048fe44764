import { execFileSync } from "node:child_process";
import { afterAll, beforeAll, expect, test } from "vitest";
import { Viewer } from "./page.ts";
import { Service } from "./service.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;

let service: Service;
let viewer: Viewer;
let token: string;

beforeAll(async () => {
  const made = keyOf("front");
  token = made.token;
  service = await Service.start(made.settings);
  viewer = await Viewer.open({ service: service.url });
}, 60_000);

afterAll(async () => {
  await viewer?.close();
  await service?.close();
});

/** A key as `prosopon auth key` makes it: its token, and the settings that allow it. */
function keyOf(id: string): { token: string; settings: string } {
  const words = ["auth", "key", "--id", id, "--tenant", "hospital-a", "--scopes", "read,write"];
  const settings = execFileSync(process.env["VIEWER_BINARY"] ?? "", words, { encoding: "utf8" });
  return { token: /^# (\S+\.\S+)$/m.exec(settings)?.[1] ?? "", settings };
}

test("the page asks for a token, and shows the problem of a wrong one", async () => {
  const { page } = viewer;
  const field = page.getByLabel("The service asks for a token");
  await field.waitFor();
  expect(await field.evaluate((input) => input === document.activeElement)).toBe(true);
  expect(await page.locator(".problem").count()).toBe(0);
  await viewer.shot("30-token-asked");
  expect(await viewer.accessibilityFindings()).toEqual([]);
  await field.fill("front.wrong");
  await field.press("Enter");
  await page.locator(".problem", { hasText: "List sessions" }).waitFor();
  await viewer.shot("31-token-wrong");
  await useToken();
  await page.locator(".problem").waitFor({ state: "detached" });
}, TEST_MS);

async function useToken(): Promise<void> {
  const { page } = viewer;
  await page.getByLabel("The service asks for a token").fill(token);
  await page.getByRole("button", { name: "Use" }).click();
  await page.getByLabel("Token", { exact: true }).waitFor();
}

test("with the token a case goes from files to the printed report", async () => {
  const { page } = viewer;
  viewer.consoleErrors.length = 0;
  await viewer.uploadPhantom("phantom, token");
  await viewer.panel("landmarks");
  await page.getByRole("button", { name: "Front", exact: true }).click();
  await viewer.dragLandmark("Pogonion");
  await page.getByRole("button", { name: "Save landmarks" }).click();
  await viewer.panel("cuts");
  await page.getByLabel("Le Fort I", { exact: true }).check();
  await page.getByRole("button", { name: "Cut the bone" }).click();
  await page.locator("[data-panel=cuts] td").first().waitFor({ timeout: JOB_MS });
  await viewer.panel("movement");
  await page.getByLabel("Forward, mm").fill("6");
  await page.getByLabel("Forward, mm").press("Tab");
  await page.getByRole("button", { name: "Plan the movement" }).click();
  await page.getByRole("button", { name: "Planned" }).waitFor({ timeout: JOB_MS });
  await viewer.predict(2, 8);
  await page.locator(".job", { hasText: "Prediction" }).getByText("succeeded").waitFor({ timeout: JOB_MS });
  await page.getByRole("button", { name: "Play the path" }).click();
  await page.getByRole("button", { name: "Pause" }).waitFor();
  await page.getByRole("button", { name: "Play the path" }).waitFor({ timeout: 30_000 });
  expect(await page.locator(".problem").count()).toBe(0);
  await printReport();
  expect(viewer.consoleErrors).toEqual([]);
}, TEST_MS);

/** Opens the report in a tab of its own, and prints it. */
async function printReport(): Promise<void> {
  const { page } = viewer;
  const opened = page.waitForEvent("popup");
  await page.getByRole("button", { name: "Report" }).click();
  const report = await opened;
  await report.waitForURL(/^blob:/);
  await report.waitForLoadState();
  // Styles and pictures of the report pass the policy of the page.
  await expect.poll(() => report.locator("body").evaluate((body) => getComputedStyle(body).fontFamily)).toMatch(/sans-serif/);
  const images = await report.locator("img").evaluateAll((all) => all.map((image) => (image as HTMLImageElement).naturalWidth));
  expect(images.length).toBeGreaterThan(0);
  expect(Math.min(...images)).toBeGreaterThan(0);
  await report.screenshot({ path: viewer.shotPath("32-report") });
  const pdf = await report.pdf({ path: viewer.shotPath("32-report").replace("png", "pdf"), preferCSSPageSize: true, printBackground: true });
  // A4, as the report's own styles say, in points.
  expect(pdf.toString("latin1")).toMatch(/MediaBox \[0 0 59[45][.\d]* 84[12][.\d]*\]/);
  await report.close();
}

test("after a reload the page asks again, and then opens the session of its address", async () => {
  const { page } = viewer;
  await page.reload();
  await useToken();
  await page.locator(".job", { hasText: "Shown" }).waitFor({ timeout: JOB_MS });
  await viewer.shot("33-token-reload");
}, TEST_MS);
