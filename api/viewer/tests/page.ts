import { mkdirSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { chromium } from "playwright-core";
import type { Browser, Locator, Page } from "playwright-core";
import { preview } from "vite";
import type { PreviewServer } from "vite";

const CHROMIUM_ARGS = [
  "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
];

/** Folder with `skin.stl`, `skull.stl` and `landmarks.json`, as `prosopon demo` writes it. */
export const PHANTOM = process.env["VIEWER_PHANTOM"] ?? "../../prosopon-demo/phantom";
const SHOTS = process.env["VIEWER_SHOTS"] ?? "shots";

const AXE = readFileSync(new URL("../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");

interface AxeResults {
  violations: { id: string; impact: string; nodes: { html: string }[] }[];
}

/** A browser on the built page, with the service behind it. */
export class Viewer {
  readonly page: Page;
  readonly url: string;
  /** Errors in the browser's console. */
  readonly consoleErrors: string[] = [];
  readonly #browser: Browser;
  readonly #server: PreviewServer;

  private constructor(page: Page, url: string, browser: Browser, server: PreviewServer) {
    this.page = page;
    this.url = url;
    this.#browser = browser;
    this.#server = server;
    page.on("pageerror", (error) => this.consoleErrors.push(String(error).slice(0, 300)));
    page.on("console", (message) => {
      if (message.type() === "error") this.consoleErrors.push(message.text().slice(0, 300));
    });
  }

  static async open(): Promise<Viewer> {
    mkdirSync(SHOTS, { recursive: true });
    const server = await preview({ preview: { port: 0, host: "127.0.0.1" }, logLevel: "error" });
    const url = server.resolvedUrls?.local[0] ?? "";
    const executablePath = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
    const browser = await chromium.launch({ executablePath, args: CHROMIUM_ARGS });
    const page = await browser.newPage({ viewport: { width: 1280, height: 860 }, colorScheme: "light" });
    const viewer = new Viewer(page, url, browser, server);
    await page.goto(url);
    return viewer;
  }

  async close(): Promise<void> {
    await this.#browser.close();
    await this.#server.close();
  }

  async shot(name: string): Promise<void> {
    // Two frames: one for the panels, one for the picture.
    await this.page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    await this.page.waitForTimeout(400);
    await this.page.screenshot({ path: join(SHOTS, `${name}.png`) });
  }

  /** Serious findings of axe-core: contrast, names, roles. The service's policy forbids to inject it as a script, so it is evaluated. */
  async accessibilityFindings(): Promise<string[]> {
    await this.page.evaluate(AXE);
    return this.page.evaluate(async () => {
      const { axe } = globalThis as unknown as { axe: { run: () => Promise<AxeResults> } };
      const { violations } = await axe.run();
      const serious = violations.filter(({ impact }) => impact === "serious" || impact === "critical");
      return serious.flatMap(({ id, nodes }) => nodes.map(({ html }) => `${id}: ${html.slice(0, 160)}`));
    });
  }

  async openSession(id: string): Promise<void> {
    await this.page.goto(`${this.url}#session=${id}`);
    // A change of the fragment alone does not load the page.
    await this.page.reload();
  }

  /** Row of a job in the list. */
  job(id: string): Locator {
    return this.page.locator(`.job[data-job="${id}"]`);
  }

  /** Row of a job, once its prediction is shown. */
  shownJob(id: string): Locator {
    return this.page.locator(`.job.chosen[data-job="${id}"]`);
  }

  /**
   * Answers as if the solve `from` still ran, missed its budget, and were continued by the solve `to`. Whether a real solve misses its
   * budget depends on the machine.
   */
  async pretendContinuation(session: string, from: string, to: string): Promise<void> {
    let ended = false;
    const patched = (job: { id: string }) => {
      if (job.id === to) return { ...job, continues: from };
      return job.id === from ? { ...job, ...(ended ? { continued_by: to } : { status: "running", step: 0 }) } : job;
    };
    await this.page.route(`**/v1/sessions/${session}`, async (route) => {
      const response = await route.fetch();
      const view = (await response.json()) as { jobs: { id: string }[] };
      const jobs = view.jobs.filter((job) => ended || job.id !== to).map(patched);
      await route.fulfill({ response, json: { ...view, jobs } });
    });
    await this.page.route(new RegExp(`/v1/jobs/(${from}|${to})$`), async (route) => {
      const response = await route.fetch();
      await route.fulfill({ response, json: patched((await response.json()) as { id: string }) });
    });
    await this.page.route(`**/v1/jobs/${from}/events`, async (route) => {
      const response = await route.fetch();
      const body = (await response.text()).replace(/("event":"end",.*"data":\{)|("data":\{)(?=.*"event":"end")/, `$1$2"continued_by":"${to}",`);
      ended = true;
      await route.fulfill({ response, body });
    });
  }

  /** Numbers of the movement panel. */
  async movement(): Promise<{ forward: string; down: string }> {
    return { forward: await this.page.getByLabel("Forward, mm").inputValue(), down: await this.page.getByLabel("Down, mm").inputValue() };
  }

  slider(name: string): Locator {
    return this.page.getByRole("slider", { name, exact: true });
  }

  /** Opens a panel. */
  async panel(name: string): Promise<void> {
    const panel = this.page.locator(`details[data-panel="${name}"]`);
    if ((await panel.getAttribute("open")) === null) await panel.locator("summary").click();
    await panel.scrollIntoViewIfNeeded();
  }

  /** Chooses a landmark in the list, drags it in the picture, and expects that its coordinates change. */
  async dragLandmark(name: string): Promise<void> {
    await this.page.getByRole("button", { name, exact: true }).click();
    const before = await this.#coordinates();
    const at = await this.#findLandmark();
    await this.page.mouse.move(at.x, at.y);
    await this.page.mouse.down();
    await this.page.mouse.move(at.x + 12, at.y, { steps: 4 });
    await this.page.waitForTimeout(200);
    await this.page.mouse.up();
    await this.page.waitForTimeout(200);
    const after = await this.#coordinates();
    if (before[0] === after[0]) throw new Error(`${name} did not move: ${before.join(" ")}`);
    // In the front view a drag to the right goes to the patient's left: +x.
    if (Number(after[0]) < Number(before[0])) throw new Error(`${name} moved to the wrong side: ${before.join(" ")} to ${after.join(" ")}`);
  }

  #coordinates(): Promise<string[]> {
    return this.page.locator("[data-panel=landmarks] input").evaluateAll((inputs) => inputs.map((input) => (input as HTMLInputElement).value));
  }

  /** Finds the cursor's place whose tip names the chosen landmark, from the chin upwards on the midline. */
  async #findLandmark(): Promise<{ x: number; y: number }> {
    const box = await this.page.locator(".picture canvas").boundingBox();
    if (!box) throw new Error("the page has no picture");
    const x = box.x + box.width / 2;
    for (let y = box.y + 0.97 * box.height; y > box.y + 0.5 * box.height; y -= 3) {
      await this.page.mouse.move(x, y);
      await this.page.waitForTimeout(60);
      const tip = this.page.locator(".tip");
      if ((await tip.isVisible()) && /^pogonion/i.test((await tip.textContent()) ?? "")) return { x, y };
    }
    throw new Error("the cursor found no pogonion on the midline");
  }

  /** Drops files of the phantom onto the page. */
  async drop(...names: string[]): Promise<void> {
    const files = names.map((name) => ({ name: basename(name), base64: readFileSync(join(PHANTOM, name)).toString("base64") }));
    await this.page.evaluate((dropped) => {
      const transfer = new DataTransfer();
      for (const { name, base64 } of dropped) {
        const bytes = Uint8Array.from(atob(base64), (char) => char.charCodeAt(0));
        transfer.items.add(new File([bytes], name));
      }
      dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true, bubbles: true }));
    }, files);
  }

  /** Share of the picture's pixels that differ from its corner: the face fills a part of it. */
  async filledShare(): Promise<number> {
    const picture = await this.page.locator(".picture canvas").screenshot();
    return this.page.evaluate(async (base64) => {
      const bytes = Uint8Array.from(atob(base64), (char) => char.charCodeAt(0));
      const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
      const canvas = new OffscreenCanvas(image.width, image.height);
      const context = canvas.getContext("2d") as OffscreenCanvasRenderingContext2D;
      context.drawImage(image, 0, 0);
      const { data } = context.getImageData(0, 0, image.width, image.height);
      const corner = 4 * (image.width * image.height - image.width + 2);
      let filled = 0;
      for (let i = 0; i < data.length; i += 4) {
        const difference = [0, 1, 2].reduce((sum, c) => sum + Math.abs((data[i + c] ?? 0) - (data[corner + c] ?? 0)), 0);
        if (difference > 24) filled += 1;
      }
      return filled / (data.length / 4);
    }, picture.toString("base64"));
  }
}
