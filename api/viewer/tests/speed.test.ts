import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { afterAll, beforeAll, expect, test } from "vitest";
import { leFortCase, planOf } from "./case.ts";
import { SHOTS, Viewer } from "./page.ts";
import { Service } from "./service.ts";

const JOB_MS = 120_000;
const TEST_MS = 300_000;
/** Number of triangles of the smaller skin. */
const SAMPLE = 60_000;

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

test("the page paints soon, and a path plays", async () => {
  const { page } = viewer;
  const paint = () => page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime);
  await expect.poll(paint).toBeGreaterThan(0);
  const firstPaintMs = await paint();
  const made = await leFortCase(service, "phantom, speed");
  const plan = await planOf(made, [0, -6, 0]);
  const { id } = await made.client.finished((await made.client.solve(made.session, { plan, steps: 2 })).id);
  await show(made.session, id);
  const start = await viewer.picture();
  const whole = { triangles: (await made.client.topology(id)).length / 3, ...(await playedFrames()) };
  await viewer.slider("Path").fill("0");
  expect((await viewer.picture()).differenceTo(start)).toBeGreaterThan(0.01);
  await sampleTriangles();
  await show(made.session, id);
  const sampled = { triangles: SAMPLE, ...(await playedFrames()) };
  writeFileSync(join(SHOTS, "speed.json"), JSON.stringify({ firstPaintMs, whole, sampled }, undefined, 2));
  // Machines differ; these limits only find a page that has become unusable.
  expect(firstPaintMs).toBeLessThan(10_000);
  expect(sampled.skin).toBeGreaterThan(0.2);
}, TEST_MS);

async function show(session: string, job: string): Promise<void> {
  const { page } = viewer;
  await viewer.openSession(session);
  await viewer.shownJob(job).getByText("succeeded").waitFor({ timeout: JOB_MS });
  await page.getByText("Load the").waitFor({ state: "hidden", timeout: JOB_MS });
  await page.getByRole("checkbox", { name: "Landmarks" }).uncheck();
}

/** Leaves every n-th triangle of the skin, and the last one of its vertices: the phantom has more triangles than most heads. */
async function sampleTriangles(): Promise<void> {
  await viewer.page.route("**/topology", async (route) => {
    const response = await route.fetch();
    const all = new Uint32Array(Uint8Array.from(await response.body()).buffer);
    const last = all.reduce((largest, vertex) => Math.max(largest, vertex), 0);
    const step = all.length / 3 / SAMPLE;
    const kept = Array.from({ length: SAMPLE - 1 }, (_, i) => 3 * Math.floor(i * step)).flatMap((at) => [...all.subarray(at, at + 3)]);
    const body = Buffer.from(Uint32Array.from([...kept, last, last, last]).buffer);
    await route.fulfill({ status: 200, contentType: "application/octet-stream", body });
  });
}

/** Frames per second while the path plays once: with bone, without, and without in the colours of displacement. */
async function playedFrames(): Promise<{ skinAndBone: number; skin: number; coloured: number }> {
  const skinAndBone = await playedOnce();
  await viewer.slider("Bone").fill("0");
  const skin = await playedOnce();
  await viewer.page.locator("select[name=colour]").selectOption("displacement");
  return { skinAndBone, skin, coloured: await playedOnce() };
}

async function playedOnce(): Promise<number> {
  const { page } = viewer;
  await page.getByRole("button", { name: "Play the path" }).click();
  const frames = page.evaluate(async () => {
    const frame = () => new Promise<number>((done) => requestAnimationFrame(done));
    const start = await frame();
    let [count, now] = [0, start];
    while (now - start < 2000) {
      now = await frame();
      count += 1;
    }
    return (1000 * count) / (now - start);
  });
  const rate = await frames;
  await page.getByRole("button", { name: "Play the path" }).waitFor({ timeout: 30_000 });
  return rate;
}
