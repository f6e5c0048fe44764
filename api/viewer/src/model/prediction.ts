import type { Frame } from "@prosopon/client";

/** Skin of one step with the path parameter at which it was solved. */
export interface Step {
  k: number;
  t: number;
  frame: Frame;
  normals: Float32Array<ArrayBuffer>;
}

/** Values that a colour map can show. */
export type ScalarName = "displacement" | "error";

/** The skins of a solve that have arrived, in order of the path; the first is the skin at rest. */
export class Prediction {
  readonly job: string;
  /** Number of steps of the job. */
  readonly total: number;
  readonly triangles: Uint32Array<ArrayBuffer>;
  readonly #steps: Step[];
  #version = 0;

  constructor(job: string, total: number, triangles: Uint32Array<ArrayBuffer>, rest: Frame) {
    this.job = job;
    this.total = total;
    this.triangles = triangles;
    this.#steps = [{ k: 0, t: 0, frame: rest, normals: vertexNormals(rest.positions, triangles) }];
  }

  get vertices(): number {
    return this.rest.frame.displacementMm.length;
  }

  get rest(): Step {
    return this.#steps[0] as Step;
  }

  get last(): Step {
    return this.#steps.at(-1) as Step;
  }

  /** Number of steps that have arrived. */
  get arrived(): number {
    return this.#steps.length - 1;
  }

  /** Changes with each step that arrives. */
  get version(): number {
    return this.#version;
  }

  /** Whether steps have an error map. */
  get hasError(): boolean {
    return this.#steps.some((step) => step.frame.errorMm !== undefined);
  }

  /** Adds a step; a step that is already there is left as it is, because steps never change. */
  add(k: number, t: number, frame: Frame): void {
    if (this.#steps.some((step) => step.k === k)) return;
    this.#steps.push({ k, t, frame, normals: vertexNormals(frame.positions, this.triangles) });
    this.#steps.sort((a, b) => a.t - b.t);
    this.#version += 1;
  }

  /** Path parameter up to which steps have arrived. */
  get reach(): number {
    return this.last.t;
  }

  /** Skin at path parameter `t`, linear between steps. `t` beyond the last step gives the last step. */
  at(t: number): { a: Step; b: Step; weight: number } {
    const next = this.#steps.findIndex((step) => step.t >= t);
    if (next === 0) return { a: this.rest, b: this.rest, weight: 0 };
    if (next < 0) return { a: this.last, b: this.last, weight: 0 };
    const [a, b] = [this.#steps[next - 1] as Step, this.#steps[next] as Step];
    return { a, b, weight: (t - a.t) / (b.t - a.t) };
  }

  /** Values of one scalar at path parameter `t`; `undefined` when the steps there have none. */
  scalarAt(name: ScalarName, t: number): Float32Array | undefined {
    const { a, b, weight } = this.at(t);
    // The skin at rest has no error map: error maps belong to solved steps.
    const from = scalarOf(a, name) ?? scalarOf(b, name);
    const to = scalarOf(b, name);
    return from && to ? mixed(from, to, weight) : undefined;
  }
}

function scalarOf(step: Step, name: ScalarName): Float32Array | undefined {
  return name === "error" ? step.frame.errorMm : step.frame.displacementMm;
}

/** (1 − weight) a + weight b, into `out` when it is given. */
export function mixed(a: Float32Array, b: Float32Array, weight: number, out: Float32Array = new Float32Array(a.length)): Float32Array {
  for (let i = 0; i < a.length; i += 1) {
    const from = a[i] as number;
    out[i] = from + weight * ((b[i] as number) - from);
  }
  return out;
}

/** Area-weighted unit normals of the vertices. */
export function vertexNormals(positions: Float32Array, triangles: Uint32Array): Float32Array<ArrayBuffer> {
  const normals = new Float32Array(positions.length);
  const p = positions as unknown as number[];
  const n = normals as unknown as number[];
  const index = triangles as unknown as number[];
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = [3 * index[i]!, 3 * index[i + 1]!, 3 * index[i + 2]!];
    const [ux, uy, uz] = [p[b]! - p[a]!, p[b + 1]! - p[a + 1]!, p[b + 2]! - p[a + 2]!];
    const [vx, vy, vz] = [p[c]! - p[a]!, p[c + 1]! - p[a + 1]!, p[c + 2]! - p[a + 2]!];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const v of [a, b, c]) {
      n[v]! += x;
      n[v + 1]! += y;
      n[v + 2]! += z;
    }
  }
  for (let v = 0; v < normals.length; v += 3) {
    const length = Math.hypot(n[v]!, n[v + 1]!, n[v + 2]!) || 1;
    n[v]! /= length;
    n[v + 1]! /= length;
    n[v + 2]! /= length;
  }
  return normals;
}
