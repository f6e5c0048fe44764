import { Quaternion, Vector3 } from "three";
import { describe, expect, test } from "vitest";
import { alongNormal, cutDocument, draftCut, isMoved, mergedCuts, movedAlong, rotationOf, shapeOf, turned, withPose } from "./draft.ts";
import type { CutDocument } from "./draft.ts";

const PLANE: CutDocument = {
  name: "le_fort_1",
  purpose: "osteotomy",
  plane: { point_mm: [1, -60, 32], normal: [0, 0, 1], bounds: { direction: [1, 0, 0], half_length_mm: 60, half_width_mm: 30 } },
};
const LINE: CutDocument = { purpose: "osteotomy", polyline: { points_mm: [[0, 0, 0], [4, 0, 0]], direction: [0, 0, -2], depth_mm: 10 } };

describe("a plane", () => {
  test("that was not moved is sent as it came", () => {
    const cut = draftCut(PLANE);
    expect(isMoved(cut)).toBe(false);
    expect(cutDocument(cut, 0)).toEqual({ ...PLANE, kerf_mm: 0 });
  });

  test("moves along its normal, and back", () => {
    const moved = movedAlong(draftCut(PLANE), 3);
    expect(cutDocument(moved, 1).plane?.point_mm).toEqual([1, -60, 35]);
    expect(alongNormal(moved)).toBe(3);
    expect(isMoved(movedAlong(moved, 0))).toBe(false);
  });

  test("turns about its length: the front goes up where the angle is negative", () => {
    const { plane } = cutDocument({ ...draftCut(PLANE), turn: [-10, 0, 0] }, 0);
    const front = new Vector3(0, -1, 0).projectOnPlane(new Vector3().fromArray(plane?.normal ?? []));
    expect(front.z).toBeGreaterThan(0.1);
    expect(plane?.bounds?.direction).toEqual([1, 0, 0]);
  });

  test("can be made longer", () => {
    const longer = { ...draftCut(PLANE), half: [70, 30] as [number, number] };
    expect(isMoved(longer)).toBe(true);
    expect(cutDocument(longer, 0).plane?.bounds).toMatchObject({ half_length_mm: 70, half_width_mm: 30 });
  });

  test("keeps its distance along the normal when it turns", () => {
    const moved = turned(movedAlong(draftCut(PLANE), 2), 1, 6);
    expect(alongNormal(moved)).toBe(2);
    expect(isMoved(turned(movedAlong(moved, 0), 1, 0))).toBe(false);
  });

  test("takes the place of a handle", () => {
    const turned = { ...draftCut(PLANE), turn: [5, -3, 20] as [number, number, number] };
    const again = withPose(draftCut(PLANE), new Vector3(1, -60, 32), rotationOf(turned));
    expect(again.turn).toEqual([5, -3, 20]);
  });
});

test("a polyline moves as a whole, is not turned, and is shown to its depth", () => {
  const moved = withPose(draftCut(LINE), new Vector3(2, 1, 0), new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), 1));
  expect(cutDocument(moved, 0.5)).toMatchObject({ kerf_mm: 0.5, polyline: { points_mm: [[0, 1, 0], [4, 1, 0]], direction: [0, 0, -2] } });
  expect(shapeOf(LINE)?.positions).toEqual([-2, 0, 0, 2, 0, 0, -2, 0, -10, 2, 0, -10]);
});

test("a separation has no kerf, and a free part no shape", () => {
  expect(cutDocument(draftCut({ ...PLANE, purpose: "separation" }), 1).kerf_mm).toBe(0);
  expect(shapeOf({ free_part: { point_mm: [0, 0, 0] } })).toBeUndefined();
});

test("a further template keeps the cuts that were moved", () => {
  const moved = movedAlong(draftCut(PLANE), 3);
  expect(mergedCuts([moved], [PLANE, LINE])).toEqual([moved, draftCut(LINE)]);
});
