import { spawn } from "node:child_process";
import type { ChildProcess } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";

/** Ports that the tests use; the first free one is taken. */
const PORTS = [18_100, 18_199] as const;
/** Time within which a service answers after its start, ms. */
const START_MS = 30_000;

/** A service of the program that `VIEWER_BINARY` names, with data of its own. */
export class Service {
  readonly port: number;
  readonly #data: string;
  #process: ChildProcess | undefined;

  private constructor(port: number, data: string) {
    this.port = port;
    this.#data = data;
  }

  /** Starts a service; `settings` is a configuration in TOML. */
  static async start(settings = ""): Promise<Service> {
    const service = new Service(await freePort(), mkdtempSync(join(tmpdir(), "prosopon-viewer-")));
    writeFileSync(service.#config, settings);
    await service.start();
    return service;
  }

  get url(): string {
    return `http://127.0.0.1:${this.port}`;
  }

  /** Starts it on its port and its data, and waits until it takes requests. */
  async start(): Promise<void> {
    const args = ["serve", "--config", this.#config, "--data", join(this.#data, "data"), "--listen", `127.0.0.1:${this.port}`];
    const started = spawn(binary(), args, { env: ownEnvironment(), stdio: ["ignore", "ignore", "pipe"] });
    this.#process = started;
    let words = "";
    started.stderr?.on("data", (chunk: Buffer) => (words = (words + chunk.toString()).slice(-2000)));
    for (const end = Date.now() + START_MS; Date.now() < end; await new Promise((done) => setTimeout(done, 100))) {
      if (started.exitCode !== null) break;
      if (await isReady(this.url)) return;
    }
    throw new Error(`the service did not start: ${words}`);
  }

  /** Ends the process at once, as a crash does. */
  async kill(): Promise<void> {
    const running = this.#process;
    this.#process = undefined;
    if (!running || running.exitCode !== null) return;
    await new Promise((done) => {
      running.once("exit", done);
      running.kill("SIGKILL");
    });
  }

  /** Ends the process and removes its data. */
  async close(): Promise<void> {
    await this.kill();
    rmSync(this.#data, { recursive: true, force: true });
  }

  get #config(): string {
    return join(this.#data, "config.toml");
  }
}

/** A port of the tests on which nothing listens. */
export async function freePort(): Promise<number> {
  for (let port = PORTS[0]; port <= PORTS[1]; port += 1) {
    if (taken.has(port) || !(await isFree(port))) continue;
    taken.add(port);
    return port;
  }
  throw new Error(`no port from ${PORTS[0]} to ${PORTS[1]} is free`);
}

/** Ports that were given away: a service may not listen on its port yet. */
const taken = new Set<number>();

function isFree(port: number): Promise<boolean> {
  return new Promise((done) => {
    const server = createServer().once("error", () => done(false));
    server.listen(port, "127.0.0.1", () => server.close(() => done(true)));
  });
}

async function isReady(url: string): Promise<boolean> {
  return fetch(`${url}/readyz`).then(({ ok }) => ok, () => false);
}

function binary(): string {
  const path = process.env["VIEWER_BINARY"];
  if (!path) throw new Error("Set VIEWER_BINARY to the program, such as ../../target/release/prosopon.");
  return path;
}

/** Settings of the caller's environment would override those of a test. */
function ownEnvironment(): NodeJS.ProcessEnv {
  return Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith("PROSOPON_")));
}
