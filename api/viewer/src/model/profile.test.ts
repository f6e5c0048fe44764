import { expect, test } from "vitest";
import { drawProfiles, largestMovement } from "./profile.ts";

const PIECES = [{
  before_yz_mm: [[-80, 100], [-110, 40], [-60, 0]],
  after_yz_mm: [[-80, 100], [-113, 44], [-60, 0]],
}];

test("the nose points to the right, and a millimetre is as long in both directions", () => {
  const drawing = drawProfiles([PIECES], 300, 420);
  const [forehead, nose, chin] = drawing?.before[0] ?? [];
  expect(drawing?.pixelsPerMm).toBe(4);
  expect(nose![0] - forehead![0]).toBeCloseTo(4 * 30);
  expect(chin![1] - forehead![1]).toBeCloseTo(4 * 100);
  expect(drawing?.height).toBeCloseTo(420);
  expect(drawing?.rows[1]! - drawing?.rows[0]!).toBeCloseTo(40);
});

test("the largest movement is that of the same point of skin", () => {
  expect(largestMovement(PIECES)).toBe(5);
});

test("a report without a profile has no drawing", () => {
  expect(drawProfiles([[]], 300, 420)).toBeUndefined();
});
