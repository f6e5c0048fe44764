import { expect, test } from "vitest";
import { colourValues, scaleOf, ticksOf } from "./colour-map.ts";

test("displacement begins at zero, errors are symmetric about it", () => {
  expect(scaleOf(Float32Array.of(0, 5.1), "displacement")).toEqual({ min: 0, max: 6 });
  expect(scaleOf(Float32Array.of(-1.4, 0.2), "error")).toEqual({ min: -1.5, max: 1.5 });
  expect(ticksOf({ min: -2, max: 2 })).toEqual([-2, -1, 0, 1, 2]);
});

test("values beyond the range and missing values have a colour", () => {
  const out = new Float32Array(12);
  colourValues(Float32Array.of(-9, 0, 9, Number.NaN), "error", { min: -1, max: 1 }, out);
  expect(out[2]).toBeGreaterThan(out[0] as number);
  expect(Math.min(out[3] as number, out[4] as number, out[5] as number)).toBeGreaterThan(0.85);
  expect(out[6]).toBeGreaterThan(out[8] as number);
  expect(out[9]).toBeCloseTo(out[11] as number);
});
