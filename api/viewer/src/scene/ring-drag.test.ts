import { PerspectiveCamera, Quaternion, Vector3 } from "three";
import { expect, test } from "vitest";
import { RingDrag } from "./ring-drag.ts";

/** In front of the face: the patient's left is on the right of the picture. */
function frontCamera(): PerspectiveCamera {
  const camera = new PerspectiveCamera(22, 1.5, 10, 5000);
  camera.up.set(0, 0, 1);
  camera.position.set(0, -700, 30);
  camera.lookAt(0, 0, 30);
  camera.updateMatrixWorld();
  return camera;
}

test("a ring that faces the camera follows the cursor", () => {
  const drag = new RingDrag(new Vector3(0, 1, 0), new Quaternion(), new Vector3(0, 0, 30));
  drag.rotationAt([0.2, 0], frontCamera());
  // A quarter turn from the right to the bottom: the patient's left side goes down.
  const turned = drag.rotationAt([0, -0.2], frontCamera()) as Quaternion;
  expect(new Vector3(1, 0, 0).applyQuaternion(turned).z).toBeCloseTo(-1, 5);
});

test("it passes the left without a jump", () => {
  const drag = new RingDrag(new Vector3(0, 1, 0), new Quaternion(), new Vector3(0, 0, 30));
  const around: [number, number][] = [[0.2, 0], [0, 0.2], [-0.2, 0.01], [-0.2, -0.01], [0, -0.2], [0.2, 0]];
  const turned = around.map((at) => drag.rotationAt(at, frontCamera())).at(-1) as Quaternion;
  expect(turned.angleTo(new Quaternion())).toBeCloseTo(0, 5);
});

test("a ring seen from its edge is left to three.js", () => {
  const drag = new RingDrag(new Vector3(0, 0, 1), new Quaternion(), new Vector3(0, 0, 30));
  expect(drag.rotationAt([0.2, 0], frontCamera())).toBeUndefined();
});
