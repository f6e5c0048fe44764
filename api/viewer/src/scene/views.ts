import { Vector3 } from "three";
import type { Camera } from "three";

/** Standard views of a face. */
export type ViewName = "front" | "three-quarter" | "profile" | "profile-left";

/** A standard view: its name on the page, its key, and the direction from the face to the camera, LPS. */
export interface StandardView {
  label: string;
  key: string;
  direction: Vector3;
}

const VIEWS: Record<ViewName, StandardView> = {
  front: { label: "Front", key: "1", direction: new Vector3(0, -1, 0) },
  "three-quarter": { label: "Three-quarter", key: "2", direction: new Vector3(-0.62, -0.78, 0.08).normalize() },
  // From the patient's right, so that the face looks to the right, as in a cephalogram.
  profile: { label: "Profile", key: "3", direction: new Vector3(-1, 0, 0) },
  "profile-left": { label: "Left profile", key: "4", direction: new Vector3(1, 0, 0) },
};

export const VIEW_NAMES = Object.keys(VIEWS) as ViewName[];

export function standardView(name: ViewName): StandardView {
  return VIEWS[name];
}

/** Sides of the patient at the left and right edge of a camera's picture: R, L, A (anterior) or P (posterior). */
export function sidesOf(camera: Camera): [string, string] {
  const { x, y } = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
  if (Math.abs(x) >= Math.abs(y)) return x > 0 ? ["R", "L"] : ["L", "R"];
  return y > 0 ? ["A", "P"] : ["P", "A"];
}
