import { Matrix4, Quaternion, Vector3 } from "three";

/** A rigid motion x′ = R x + T; the rotation R is a unit quaternion and T is in mm. */
export interface RigidMotion {
  rotation: Quaternion;
  translation: Vector3;
}

/** Rotations below this angle are treated as translations, rad: their screw axis lies farther away than 1e6 mm. */
const SMALLEST_ANGLE = 1e-7;

export function identity(): RigidMotion {
  return { rotation: new Quaternion(), translation: new Vector3() };
}

/** Motion that rotates about `pivot` and then translates. */
export function aboutPivot(rotation: Quaternion, pivot: Vector3, translation: Vector3): RigidMotion {
  const moved = pivot.clone().applyQuaternion(rotation);
  return { rotation: rotation.clone(), translation: pivot.clone().sub(moved).add(translation) };
}

/** `b` after `a`. */
export function compose(b: RigidMotion, a: RigidMotion): RigidMotion {
  return {
    rotation: b.rotation.clone().multiply(a.rotation),
    translation: a.translation.clone().applyQuaternion(b.rotation).add(b.translation),
  };
}

export function inverse(motion: RigidMotion): RigidMotion {
  const rotation = motion.rotation.clone().invert();
  return { rotation, translation: motion.translation.clone().negate().applyQuaternion(rotation) };
}

/**
 * Share `s` of a motion along its screw axis: 0 gives the identity, 1 the motion.
 *
 * Source: Chasles' theorem; the axis passes through c = ½ (T⊥ + cot(θ/2) a × T⊥).
 */
export function partOf(motion: RigidMotion, s: number): RigidMotion {
  const q = motion.rotation.w < 0 ? negated(motion.rotation) : motion.rotation.clone().normalize();
  const sine = Math.hypot(q.x, q.y, q.z);
  const angle = 2 * Math.atan2(sine, q.w);
  if (angle < SMALLEST_ANGLE) return { rotation: new Quaternion(), translation: motion.translation.clone().multiplyScalar(s) };
  const axis = new Vector3(q.x, q.y, q.z).divideScalar(sine);
  const along = axis.clone().multiplyScalar(motion.translation.dot(axis));
  const across = motion.translation.clone().sub(along);
  const centre = axis.clone().cross(across).divideScalar(Math.tan(angle / 2)).add(across).multiplyScalar(0.5);
  return aboutPivot(new Quaternion().setFromAxisAngle(axis, s * angle), centre, along.multiplyScalar(s));
}

/** Motion at share `s` of the screw motion from `a` to `b`. */
export function between(a: RigidMotion, b: RigidMotion, s: number): RigidMotion {
  return compose(partOf(compose(b, inverse(a)), s), a);
}

export function matrixOf(motion: RigidMotion): Matrix4 {
  return new Matrix4().makeRotationFromQuaternion(motion.rotation).setPosition(motion.translation);
}

function negated(q: Quaternion): Quaternion {
  return new Quaternion(-q.x, -q.y, -q.z, -q.w).normalize();
}
