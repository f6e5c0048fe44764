import type { components } from "@prosopon/client";
import { Euler, MathUtils, Quaternion, Vector3 } from "three";
import { aboutPivot, between, identity, partOf } from "./screw.ts";
import type { RigidMotion } from "./screw.ts";

type Schemas = components["schemas"];

/** A point or direction x, y, z, LPS. */
export type Point = [number, number, number];

/** How a segment moves. */
export type MotionKind = "rest" | "free" | "hinge" | "autorotate";

/** Planned motion of one segment, as the number fields show it. */
export interface Motion {
  kind: MotionKind;
  /** Translation, mm. */
  forward: number;
  left: number;
  down: number;
  /** Rotation about the pivot, degrees: roll first, then pitch, then yaw. */
  pitch: number;
  roll: number;
  yaw: number;
  /** Fixed point of the rotation, LPS mm. */
  pivot: Point;
  /** Name of the pivot: `centroid`, a landmark, or `point`. */
  pivotName: string;
  /** Opening angle of a hinge about the condyles, degrees. */
  openDeg: number;
  /** Segment that an autorotation follows. */
  follows: number;
}

/** Number fields of a free motion. */
export type FreeField = "forward" | "left" | "down" | "pitch" | "roll" | "yaw";

export function restMotion(centroid: Point): Motion {
  const none = { forward: 0, left: 0, down: 0, pitch: 0, roll: 0, yaw: 0, openDeg: 0, follows: 1 };
  return { kind: "rest", pivot: centroid, pivotName: "centroid", ...none };
}

/** LPS translation of a motion: forward is -y, left is +x, down is -z. */
export function translationOf(motion: Motion): Vector3 {
  return new Vector3(motion.left, -motion.forward, -motion.down);
}

/** Rotation of a motion. */
export function rotationOf(motion: Motion): Quaternion {
  const [pitch, roll, yaw] = [motion.pitch, motion.roll, motion.yaw].map(MathUtils.degToRad) as Point;
  // three.js writes the last rotation first: yaw (z) · pitch (x) · roll (y).
  return new Quaternion().setFromEuler(new Euler(pitch, roll, yaw, "ZXY"));
}

/** The motion whose translation and rotation are those of a handle that began at the pivot. */
export function withHandle(motion: Motion, position: Vector3, rotation: Quaternion): Motion {
  const [x, y, z] = motion.pivot;
  const angles = new Euler().setFromQuaternion(rotation, "ZXY");
  return {
    ...motion,
    kind: "free",
    left: rounded(position.x - x, 100),
    forward: rounded(y - position.y, 100),
    down: rounded(z - position.z, 100),
    pitch: rounded(MathUtils.radToDeg(angles.x), 10),
    roll: rounded(MathUtils.radToDeg(angles.y), 10),
    yaw: rounded(MathUtils.radToDeg(angles.z), 10),
  };
}

/** The motion at the end of a planned path, about the segment's centroid. */
export function motionOfPath(path: Schemas["PathDocument"], centroid: Point): Motion {
  const { rotation, translation } = plannedAt(path, 1);
  const position = new Vector3(...centroid).applyQuaternion(rotation).add(translation);
  return withHandle(restMotion(centroid), position, rotation);
}

function rounded(value: number, parts: number): number {
  // `+ 0` turns -0 into 0.
  return Math.round(value * parts) / parts + 0;
}

/** Rigid motion at path parameter `t` before the service has planned it; a hinge needs both condyles. */
export function draftAt(motion: Motion, t: number, condyles: [Point, Point] | undefined): RigidMotion {
  if (motion.kind === "free") {
    return partOf(aboutPivot(rotationOf(motion), new Vector3(...motion.pivot), translationOf(motion)), t);
  }
  if (motion.kind === "hinge" && condyles) {
    const [right, left] = condyles.map((p) => new Vector3(...p)) as [Vector3, Vector3];
    const axis = left.clone().sub(right).normalize();
    const turn = new Quaternion().setFromAxisAngle(axis, MathUtils.degToRad(motion.openDeg));
    return partOf(aboutPivot(turn, right, new Vector3()), t);
  }
  return identity();
}

/** Rigid motion of a planned path at path parameter `t`; the service joins waypoints by screw motions. */
export function plannedAt(path: Schemas["PathDocument"], t: number): RigidMotion {
  let before = { t: 0, motion: identity() };
  for (const waypoint of path.waypoints) {
    const motion = waypointMotion(waypoint);
    if (waypoint.t >= t) {
      const span = waypoint.t - before.t;
      return span <= 0 ? motion : between(before.motion, motion, (t - before.t) / span);
    }
    before = { t: waypoint.t, motion };
  }
  return before.motion;
}

function waypointMotion(waypoint: Schemas["WaypointDocument"]): RigidMotion {
  return {
    rotation: new Quaternion().fromArray(waypoint.quaternion_xyzw),
    translation: new Vector3().fromArray(waypoint.translation_mm),
  };
}

/** Body of the path of a segment; `undefined` for a segment at rest. */
export function pathRequest(segment: number, motion: Motion): Schemas["PathRequest"] | undefined {
  switch (motion.kind) {
    case "rest":
      return undefined;
    case "autorotate":
      return { segment, autorotate: { follows: motion.follows } };
    case "hinge":
      return { segment, waypoints: [{ t: 1, hinge: { angle_deg: motion.openDeg } }] };
    case "free":
      return { segment, waypoints: [freeWaypoint(motion)] };
  }
}

function freeWaypoint(motion: Motion): Schemas["WaypointRequest"] {
  const waypoint: Schemas["WaypointRequest"] = { t: 1, translation_mm: translationOf(motion).toArray() };
  if (motion.pitch !== 0 || motion.roll !== 0 || motion.yaw !== 0) {
    const angles = { pitch_deg: motion.pitch, roll_deg: motion.roll, yaw_deg: motion.yaw };
    waypoint.rotation = { pitch_roll_yaw: angles, pivot_mm: motion.pivot };
  }
  return waypoint;
}
