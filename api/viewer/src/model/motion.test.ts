import { Vector3 } from "three";
import { expect, test } from "vitest";
import { draftAt, motionOfPath, pathRequest, plannedAt, restMotion, rotationOf } from "./motion.ts";
import type { Motion } from "./motion.ts";
import { matrixOf } from "./screw.ts";

const free = (patch: Partial<Motion>): Motion => ({ ...restMotion([0, -60, 20]), kind: "free", ...patch });

test("forward is -y, left is +x, down is -z", () => {
  const request = pathRequest(1, free({ forward: 6, left: 1, down: 1.5 }));
  expect(request).toEqual({ segment: 1, waypoints: [{ t: 1, translation_mm: [1, -6, -1.5] }] });
});

test("signs of the angles are those of the API", () => {
  const front = new Vector3(0, -1, 0);
  expect(front.clone().applyQuaternion(rotationOf(free({ pitch: 10 }))).z).toBeLessThan(0);
  expect(front.clone().applyQuaternion(rotationOf(free({ yaw: 10 }))).x).toBeGreaterThan(0);
  const left = new Vector3(1, 0, 0);
  expect(left.clone().applyQuaternion(rotationOf(free({ roll: 10 }))).z).toBeLessThan(0);
});

test("a segment at rest has no path", () => {
  expect(pathRequest(1, restMotion([0, 0, 0]))).toBeUndefined();
});

test("a hinge opens the mouth with a positive angle", () => {
  const motion: Motion = { ...restMotion([0, -60, -20]), kind: "hinge", openDeg: 10 };
  const chin = new Vector3(0, -80, -40).applyMatrix4(matrixOf(draftAt(motion, 1, [[-48, 8, 38], [48, 8, 38]])));
  expect(chin.z).toBeLessThan(-40);
});

test("a plan between waypoints is a screw motion, and its end can be edited", () => {
  const rest = { t: 0, translation_mm: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1] };
  const end = { t: 1, translation_mm: [0, -6, -1.5], quaternion_xyzw: [0, 0, 0, 1] };
  const path = { segment: 1, waypoints: [rest, end] };
  expect(plannedAt(path, 0.5).translation.toArray()).toEqual([0, -3, -0.75]);
  expect(motionOfPath(path, [0, -60, 20])).toMatchObject({ kind: "free", forward: 6, left: 0, down: 1.5, pitch: 0 });
});
