import { mixed } from "./prediction.ts";
import type { Prediction } from "./prediction.ts";

/** Two predictions side by side. */
export class Comparison {
  readonly first: Prediction;
  readonly second: Prediction;
  /** Whether both skins have the same triangles; otherwise their vertices cannot be compared. */
  readonly isComparable: boolean;
  #largest: { versions: string; mm: number } | undefined;

  constructor(first: Prediction, second: Prediction) {
    this.first = first;
    this.second = second;
    this.isComparable = areEqual(first.triangles, second.triangles);
  }

  /** Distance between the two skins at each vertex, mm, at path parameter `t`; `undefined` when they have other triangles. */
  distanceAt(t: number): Float32Array<ArrayBuffer> | undefined {
    if (!this.isComparable) return undefined;
    const [a, b] = [positionsAt(this.first, t), positionsAt(this.second, t)];
    const distances = new Float32Array(a.length / 3);
    for (let v = 0; v < distances.length; v += 1) {
      const i = 3 * v;
      distances[v] = Math.hypot(a[i]! - b[i]!, a[i + 1]! - b[i + 1]!, a[i + 2]! - b[i + 2]!);
    }
    return distances;
  }

  /** Largest distance at the end of the paths, mm; `undefined` when the skins have other triangles. */
  get largestMm(): number | undefined {
    const versions = `${this.first.version} ${this.second.version}`;
    if (this.#largest?.versions === versions) return this.#largest.mm;
    const mm = this.distanceAt(1)?.reduce((most, distance) => Math.max(most, distance), 0);
    if (mm !== undefined) this.#largest = { versions, mm };
    return mm;
  }
}

function positionsAt(prediction: Prediction, t: number): Float32Array {
  const { a, b, weight } = prediction.at(t);
  return weight === 0 ? a.frame.positions : mixed(a.frame.positions, b.frame.positions, weight);
}

function areEqual(a: Uint32Array, b: Uint32Array): boolean {
  return a.length === b.length && a.every((value, i) => value === b[i]);
}
