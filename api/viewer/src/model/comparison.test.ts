import { expect, test } from "vitest";
import { Comparison } from "./comparison.ts";
import { Prediction } from "./prediction.ts";

const TRIANGLES = Uint32Array.of(0, 1, 2);
const at = (x: number, y: number) => ({
  positions: Float32Array.of(x, y, 0, 1 + x, y, 0, x, y, 1),
  displacementMm: Float32Array.of(0, 0, 0),
});

function moved(x: number, y: number, triangles = TRIANGLES): Prediction {
  const prediction = new Prediction("j", 1, triangles, at(0, 0));
  prediction.add(1, 1, at(x, y));
  return prediction;
}

test("the distance is that of the same vertex at the same place of the path", () => {
  const comparison = new Comparison(moved(0, -6), moved(3, -2));
  expect([...(comparison.distanceAt(1) ?? [])]).toEqual([5, 5, 5]);
  expect([...(comparison.distanceAt(0.5) ?? [])]).toEqual([2.5, 2.5, 2.5]);
  expect(comparison.largestMm).toBe(5);
  expect([...(comparison.distanceAt(0) ?? [])]).toEqual([0, 0, 0]);
});

test("skins with other triangles have no distance", () => {
  const comparison = new Comparison(moved(0, -6), moved(0, -6, Uint32Array.of(0, 2, 1)));
  expect(comparison.isComparable).toBe(false);
  expect(comparison.distanceAt(1)).toBeUndefined();
});
