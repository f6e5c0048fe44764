import { expect, test } from "vitest";
import { Prediction } from "./prediction.ts";

const TRIANGLES = Uint32Array.of(0, 1, 2);
const at = (y: number, errorMm?: number) => ({
  positions: Float32Array.of(0, y, 0, 1, y, 0, 0, y, 1),
  displacementMm: Float32Array.of(-y, -y, -y),
  ...(errorMm === undefined ? {} : { errorMm: Float32Array.of(errorMm, errorMm, errorMm) }),
});

test("skins between steps are linear, and steps may arrive in any order", () => {
  const prediction = new Prediction("j", 2, TRIANGLES, at(0));
  prediction.add(2, 1, at(-6));
  prediction.add(1, 0.5, at(-2));
  expect(prediction.arrived).toBe(2);
  expect([...(prediction.scalarAt("displacement", 0.75) ?? [])]).toEqual([4, 4, 4]);
  expect(prediction.at(2).a.k).toBe(2);
});

test("the path ends at the last step that has arrived", () => {
  const prediction = new Prediction("j", 4, TRIANGLES, at(0));
  expect(prediction.reach).toBe(0);
  prediction.add(1, 0.25, at(-1));
  expect(prediction.reach).toBe(0.25);
  expect([...(prediction.scalarAt("displacement", 1) ?? [])]).toEqual([1, 1, 1]);
});

test("the skin before the first error map has the values of that step", () => {
  const prediction = new Prediction("j", 1, TRIANGLES, at(0));
  expect(prediction.hasError).toBe(false);
  prediction.add(1, 1, at(-6, -0.5));
  expect(prediction.hasError).toBe(true);
  expect([...(prediction.scalarAt("error", 0.5) ?? [])]).toEqual([-0.5, -0.5, -0.5]);
});

test("normals point outwards of a counter-clockwise triangle", () => {
  const prediction = new Prediction("j", 1, TRIANGLES, at(0));
  expect([...prediction.rest.normals.slice(0, 3)].map((n) => n + 0)).toEqual([0, -1, 0]);
});
