import { PerspectiveCamera, Vector3 } from "three";
import { expect, test } from "vitest";
import { sidesOf, standardView } from "./views.ts";
import type { ViewName } from "./views.ts";

function cameraOf(view: ViewName): PerspectiveCamera {
  const camera = new PerspectiveCamera();
  camera.up.set(0, 0, 1);
  camera.position.copy(standardView(view).direction).multiplyScalar(500);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
  return camera;
}

test("the patient's left is on the right of the front view", () => {
  const camera = cameraOf("front");
  expect(new Vector3(50, -80, 0).project(camera).x).toBeGreaterThan(0);
  expect(new Vector3(0, -80, 50).project(camera).y).toBeGreaterThan(0);
  expect(sidesOf(camera)).toEqual(["R", "L"]);
});

test("the face looks to the right in the profile", () => {
  expect(sidesOf(cameraOf("profile"))).toEqual(["P", "A"]);
  expect(sidesOf(cameraOf("profile-left"))).toEqual(["A", "P"]);
});
