import { Quaternion, Vector3 } from "three";
import { expect, test } from "vitest";
import { aboutPivot, between, matrixOf, partOf } from "./screw.ts";
import type { RigidMotion } from "./screw.ts";

const AXIS = new Vector3(1, 2, -0.5).normalize();
const turn = (degrees: number) => new Quaternion().setFromAxisAngle(AXIS, (degrees * Math.PI) / 180);
const MOTION = aboutPivot(turn(40), new Vector3(10, -60, 20), new Vector3(1, -6, 2));

function expectSame(a: RigidMotion, b: RigidMotion): void {
  const point = new Vector3(7, -50, 12);
  const places = [a, b].map((motion) => point.clone().applyMatrix4(matrixOf(motion)));
  expect(places[0]?.distanceTo(places[1] as Vector3)).toBeLessThan(1e-9);
}

test("a motion about a pivot moves the pivot by the translation", () => {
  const moved = new Vector3(10, -60, 20).applyMatrix4(matrixOf(MOTION));
  expect(moved.distanceTo(new Vector3(11, -66, 22))).toBeLessThan(1e-12);
});

test("the whole of a screw motion is the motion, and nothing of it is rest", () => {
  expectSame(partOf(MOTION, 1), MOTION);
  expectSame(partOf(MOTION, 0), { rotation: new Quaternion(), translation: new Vector3() });
});

test("two halves of a screw motion make the whole", () => {
  const half = partOf(MOTION, 0.5);
  expectSame(between(half, MOTION, 1), MOTION);
  const twice = matrixOf(half).multiply(matrixOf(half));
  const whole = matrixOf(MOTION);
  twice.elements.forEach((value, i) => expect(value).toBeCloseTo(whole.elements[i] as number, 9));
});

test("a translation is divided evenly", () => {
  const slide = { rotation: new Quaternion(), translation: new Vector3(0, -6, 0) };
  expect(partOf(slide, 0.25).translation.toArray()).toEqual([0, -1.5, 0]);
});
