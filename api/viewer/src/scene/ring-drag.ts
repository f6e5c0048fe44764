import { Quaternion, Vector3 } from "three";
import type { PerspectiveCamera } from "three";

/** Cosine of the angle between a ring's axis and the line of sight above which the ring is seen as a ring, and not as a line. */
const FACING = 0.5;

/**
 * Dragging a ring that faces the camera.
 *
 * `TransformControls` turns it by the part of the drag across the line of sight and the axis; where both point the same way, that
 * direction is arbitrary, and the ring may turn against the cursor.
 */
export class RingDrag {
  readonly #axis: Vector3;
  readonly #start: Quaternion;
  readonly #centre: Vector3;
  #last: number | undefined;
  #sum = 0;

  /** `axis` is the ring's axis and `start` the rotation at the start of the drag; `centre` is that of the ring, LPS mm. */
  constructor(axis: Vector3, start: Quaternion, centre: Vector3) {
    this.#axis = axis.clone();
    this.#start = start.clone();
    this.#centre = centre.clone();
  }

  /** The rotation for a cursor, normalised device coordinates; `undefined` for a ring that the camera sees from its edge. */
  rotationAt([x, y]: [number, number], camera: PerspectiveCamera): Quaternion | undefined {
    const facing = camera.position.clone().sub(this.#centre).normalize().dot(this.#axis);
    if (Math.abs(facing) < FACING) return undefined;
    const centre = this.#centre.clone().project(camera);
    const angle = Math.atan2(y - centre.y, (x - centre.x) * camera.aspect);
    const change = angle - (this.#last ?? angle);
    // The angle jumps by a whole turn at the left.
    this.#sum += Math.atan2(Math.sin(change), Math.cos(change));
    this.#last = angle;
    return new Quaternion().setFromAxisAngle(this.#axis, Math.sign(facing) * this.#sum).multiply(this.#start);
  }
}
