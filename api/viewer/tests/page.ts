import { mkdirSync, readFileSync } from "node:fs";
import { basename, join } from "node:path";
import { chromium } from "playwright-core";
import type { Browser, Locator, Page } from "playwright-core";
import { preview } from "vite";
import type { PreviewServer } from "vite";
import { readPicture } from "./picture.ts";
import type { Colour, Edge, Picture, Place } from "./picture.ts";
import { freePort } from "./service.ts";

const CHROMIUM_ARGS = [
  "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
];

/** Folder with `skin.stl`, `skull.stl` and `landmarks.json`, as `prosopon demo` writes it. */
export const PHANTOM = process.env["VIEWER_PHANTOM"] ?? "../../prosopon-demo/phantom";
export const SHOTS = process.env["VIEWER_SHOTS"] ?? "shots";

const AXE = readFileSync(new URL("../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");

interface AxeResults {
  violations: { id: string; impact: string; nodes: { html: string }[] }[];
}

/** How a page is served. */
export interface Serving {
  /** Address of the service. */
  service: string;
  /** Port of the page; a free one when absent. */
  port?: number;
  /** Whether the page calls the service across origins; otherwise its own server passes the calls on. */
  isForeign?: boolean;
  /** Whether the browser has a touch screen. */
  hasTouch?: boolean;
}

/** An axis of a handle, and how the tests find it in the picture. */
export interface HandleAxis {
  /** Name of the buttons that show the handle, and the one that shows this axis. */
  group: string;
  mode: "Move" | "Turn";
  /** three.js draws x red, y green, z blue. */
  colour: Colour;
  /** End of the arrow, or place on the ring, that is dragged. Rings cross at the right and at the top. */
  edge: Edge;
  tip: string;
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

  static async open(serving: Serving): Promise<Viewer> {
    mkdirSync(SHOTS, { recursive: true });
    const server = await served(serving);
    const url = server.resolvedUrls?.local[0] ?? "";
    const executablePath = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
    const browser = await chromium.launch({ executablePath, args: CHROMIUM_ARGS });
    const hasTouch = serving.hasTouch === true;
    const page = await browser.newPage({ viewport: { width: 1280, height: 860 }, colorScheme: "light", hasTouch });
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
    await this.page.screenshot({ path: this.shotPath(name) });
  }

  shotPath(name: string): string {
    return join(SHOTS, `${name}.png`);
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

  /** Creates a session of the phantom by the page alone, up to its landmarks. */
  async uploadPhantom(label: string): Promise<void> {
    const { page } = this;
    await page.getByLabel("Label").fill(label);
    await page.getByRole("button", { name: "New session" }).click();
    await page.locator(".sessions .chosen").waitFor();
    await this.drop("skin.stl", "skull.stl", "landmarks.json");
    await page.locator(".parts div", { hasText: "Landmarks" }).getByText("ready").waitFor({ timeout: 120_000 });
    await page.getByText("Load the").waitFor({ state: "hidden", timeout: 120_000 });
  }

  /** Starts a prediction by the page. */
  async predict(steps: number, edgeMm: number): Promise<void> {
    const { page } = this;
    await this.panel("prediction");
    await page.getByLabel("Steps").fill(String(steps));
    await page.getByLabel("Edge length, mm").fill(String(edgeMm));
    await page.getByLabel("Edge length, mm").press("Tab");
    await page.getByRole("button", { name: "Predict the face" }).click();
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

  /** Numbers of a free movement in the movement panel. */
  async motion(): Promise<Record<"forward" | "left" | "down" | "pitch" | "roll" | "yaw", number>> {
    const field = async (name: string) => Number(await this.page.locator(`[data-panel=movement] input[name=${name}]`).inputValue());
    const [forward, left, down] = [await field("forward"), await field("left"), await field("down")];
    return { forward, left, down, pitch: await field("pitch"), roll: await field("roll"), yaw: await field("yaw") };
  }

  /** Drags an axis of a handle, by pixels to the right and down; expects that the tip names the axis. */
  async dragHandle(axis: HandleAxis, [right, down]: [number, number]): Promise<void> {
    const { group, mode, colour, edge, tip } = axis;
    const buttons = this.page.getByRole("group", { name: group });
    await buttons.getByRole("button", { name: "No handles" }).click();
    await this.page.mouse.move(5, 5);
    const without = await this.picture();
    await buttons.getByRole("button", { name: mode, exact: true }).click();
    const at = (await this.picture()).edgeOf(colour, without, edge);
    const box = await this.page.locator(".picture canvas").boundingBox();
    if (!box || !at) throw new Error(`the picture has no ${colour} handle`);
    // From the tip of the arrow, or the rim of the ring, towards the middle.
    const inward = { right: [-1, 0], top: [0, 1], corner: [-0.7, 0.7] }[edge];
    const seen: (string | null)[] = [];
    for (const px of [2, 5, 8, 0, 12]) {
      const [x, y] = [box.x + at[0] * box.width + px * (inward[0] ?? 0), box.y + at[1] * box.height + px * (inward[1] ?? 0)];
      await this.page.mouse.move(x, y);
      await this.page.waitForTimeout(500);
      seen.push(await this.page.locator(".tip").textContent());
      if (seen.at(-1) !== tip) continue;
      await this.page.mouse.down();
      await this.page.mouse.move(x + right, y + down, { steps: 4 });
      await this.page.waitForTimeout(300);
      await this.page.mouse.up();
      await this.page.mouse.move(5, 5);
      return;
    }
    throw new Error(`at the ${colour} handle the tips say ${seen.join(", ")} instead of ${tip}`);
  }

  /** Place of a landmark in the picture: where it grows when it is chosen after `other`. It lies in other rows (shares) than `other`. */
  async markerPlace(name: string, other: string, rows: [number, number]): Promise<Place> {
    await this.page.getByRole("button", { name: other, exact: true }).click();
    const before = await this.picture();
    await this.page.getByRole("button", { name, exact: true }).click();
    return (await this.picture()).centreOfDifference(before, rows);
  }

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

  /** Finds pogonion by its tip, from the chin upwards on the midline. */
  async #findLandmark(): Promise<{ x: number; y: number }> {
    const box = await this.page.locator(".picture canvas").boundingBox();
    if (!box) throw new Error("the page has no picture");
    const tip = this.page.locator(".tip");
    const x = box.x + box.width / 2;
    for (let y = box.y + 0.97 * box.height; y > box.y + 0.5 * box.height; y -= 3) {
      await this.page.mouse.move(x, y);
      await this.page.waitForTimeout(60);
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

  /** The picture as it is now. */
  async picture(): Promise<Picture> {
    // Two frames: one for the state, one for the drawing.
    await this.page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    await this.page.waitForTimeout(300);
    return readPicture(this.page, await this.page.locator(".picture canvas").screenshot());
  }

  /** Share of the picture's pixels that differ from its corner: the face fills a part of it. */
  async filledShare(): Promise<number> {
    return (await this.picture()).filledShare();
  }
}

/** Serves the built page under a strict policy. */
async function served({ service, port, isForeign }: Serving): Promise<PreviewServer> {
  // The policy with which the service sends the page.
  const policy = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; "
    + `form-action 'none'; connect-src 'self'${isForeign ? ` ${service}` : ""}`;
  const own = { target: service, changeOrigin: true, headers: { origin: service } };
  const html = readFileSync(new URL("../dist/index.html", import.meta.url), "utf8");
  const addressed = html.replace(/(name="prosopon-service" content=")"/, `$1${service}"`);
  if (addressed === html) throw new Error("the page has no place for the address of the service");
  return preview({
    logLevel: "error",
    preview: {
      host: "127.0.0.1",
      port: port ?? (await freePort()),
      strictPort: true,
      proxy: isForeign ? {} : { "/v1": own },
      headers: { "content-security-policy": policy },
    },
    plugins: [{
      name: "address",
      configurePreviewServer: ({ middlewares }) => {
        middlewares.use((request, response, next) => {
          if (!isForeign || !/^\/(\?|$)/.test(request.url ?? "")) return next();
          response.writeHead(200, { "content-type": "text/html", "content-security-policy": policy }).end(addressed);
        });
      },
    }],
  });
}
