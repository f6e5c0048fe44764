import type { components, Finding } from "@prosopon/client";
import { Euler, MathUtils, Matrix4, Quaternion, Vector3 } from "three";
import type { Point } from "./motion.ts";

type Schemas = components["schemas"];
export type CutDocument = Schemas["CutDocument"];
export type TemplateName = Schemas["TemplateName"];

/** A template and the landmarks that place its cuts. */
export type TemplateView = Schemas["TemplateView"];

/** A cut that the service has placed and the user may have moved. */
export interface DraftCut {
  /** The cut where the template places it. */
  original: CutDocument;
  /** Centre of a plane, or mean of the points of a polyline, LPS mm. */
  centre: Point;
  /** Turn of a plane from its original place about its length, its width and its normal, degrees; applied in this order, own axes. */
  turn: Point;
  /** Half length and half width of a plane with bounds, mm. */
  half: [number, number] | undefined;
}

export type DraftHandle = "off" | "translate" | "rotate";

/** Cuts before the bone is cut. */
export interface Draft {
  templates: TemplateName[];
  cuts: readonly DraftCut[];
  warnings: readonly Finding[];
  /** Index of the cut that handles and numbers move. */
  selected: number;
  handle: DraftHandle;
}

/** Half extents with which a plane without bounds is shown, mm. */
const UNBOUNDED_MM = 60;

/** A cut at its original place. */
export function draftCut(original: CutDocument): DraftCut {
  return { original, centre: originalCentre(original), turn: [0, 0, 0], half: halfOf(original) };
}

/** Cuts of a new preview; those that were moved, and that the service places as before, stay moved. */
export function mergedCuts(known: readonly DraftCut[], placed: readonly CutDocument[]): DraftCut[] {
  return placed.map((cut) => {
    const text = JSON.stringify(cut);
    return known.find(({ original }) => JSON.stringify(original) === text) ?? draftCut(cut);
  });
}

export function isPlane({ original }: DraftCut): boolean {
  return original.plane != null;
}

/** Whether a cut can be moved: a free part has no shape of its own. */
export function isMovable({ original }: DraftCut): boolean {
  return original.plane != null || original.polyline != null;
}

/** Whether a cut is not as the template places it. */
export function isMoved({ original, centre, turn, half }: DraftCut): boolean {
  const from = originalCentre(original);
  if (half?.some((value, i) => value !== halfOf(original)?.[i])) return true;
  return turn.some((angle) => angle !== 0) || centre.some((value, i) => Math.abs(value - (from[i] as number)) > 1e-9);
}

/** Axes of a cut where it stands: x along its length, y along its width, z along its normal. Those of a polyline are the axes of LPS. */
export function rotationOf({ original, turn }: DraftCut): Quaternion {
  const [x, y, z] = turn.map(MathUtils.degToRad) as Point;
  return axesOf(original).multiply(new Quaternion().setFromEuler(new Euler(x, y, z, "XYZ")));
}

/** Unit normal of a plane where it stands. */
export function normalOf(cut: DraftCut): Vector3 {
  return new Vector3(0, 0, 1).applyQuaternion(rotationOf(cut));
}

/** Distance of a plane's centre from its original place along the normal, mm. */
export function alongNormal(cut: DraftCut): number {
  const moved = new Vector3(...cut.centre).sub(new Vector3(...originalCentre(cut.original)));
  return rounded(moved.dot(normalOf(cut)), 100);
}

/** The plane moved along its normal until `alongNormal` has a value. */
export function movedAlong(cut: DraftCut, mm: number): DraftCut {
  const centre = new Vector3(...cut.centre).addScaledVector(normalOf(cut), mm - alongNormal(cut)).toArray();
  return { ...cut, centre };
}

/** Displacement of a cut from its original place, LPS mm. */
export function displacementOf({ original, centre }: DraftCut): Point {
  const from = originalCentre(original);
  return centre.map((value, i) => rounded(value - (from[i] as number), 100)) as Point;
}

/** The cut displaced from its original place along one axis. */
export function displaced(cut: DraftCut, axis: number, mm: number): DraftCut {
  return { ...cut, centre: cut.centre.with(axis, (originalCentre(cut.original)[axis] as number) + mm) as Point };
}

/** The plane turned about its original centre, so that its distance along its normal stays. */
export function turned(cut: DraftCut, axis: number, degrees: number): DraftCut {
  const from = new Vector3(...originalCentre(cut.original));
  const next = { ...cut, turn: cut.turn.with(axis, degrees) as Point };
  const own = new Vector3(...cut.centre).sub(from).applyQuaternion(rotationOf(cut).invert());
  return { ...next, centre: own.applyQuaternion(rotationOf(next)).add(from).toArray() };
}

/** The cut where a handle is. */
export function withPose(cut: DraftCut, position: Vector3, rotation: Quaternion): DraftCut {
  const own = axesOf(cut.original).invert().multiply(rotation);
  const { x, y, z } = new Euler().setFromQuaternion(own, "XYZ");
  const turn = [x, y, z].map((angle) => rounded(MathUtils.radToDeg(angle), 10)) as Point;
  return { ...cut, centre: position.toArray(), turn: isPlane(cut) ? turn : cut.turn };
}

/** The cut as the service takes it, with a kerf for a cut by a saw. */
export function cutDocument(cut: DraftCut, kerfMm: number): CutDocument {
  const { original, centre } = cut;
  const isSawn = original.purpose !== "separation" && original.free_part == null;
  const kerf_mm = isSawn ? kerfMm : 0;
  if (original.plane) {
    const direction = new Vector3(1, 0, 0).applyQuaternion(rotationOf(cut)).toArray();
    const [half_length_mm, half_width_mm] = cut.half ?? [0, 0];
    const bounds = cut.half && { direction, half_length_mm, half_width_mm };
    return { ...original, kerf_mm, plane: { ...original.plane, point_mm: centre, normal: normalOf(cut).toArray(), ...(bounds ? { bounds } : {}) } };
  }
  if (original.polyline) {
    const from = originalCentre(original);
    const points_mm = original.polyline.points_mm.map((point) => point.map((value, i) => value + (centre[i] as number) - (from[i] as number)));
    return { ...original, kerf_mm, polyline: { ...original.polyline, points_mm } };
  }
  return { ...original, kerf_mm };
}

/** Half extents with which a plane is shown, mm; 1 for the shape of a polyline. */
export function extentOf({ original, half }: DraftCut): [number, number] {
  return original.plane ? (half ?? [UNBOUNDED_MM, UNBOUNDED_MM]) : [1, 1];
}

/** Triangles of a cut about its centre and in its axes; nothing for a free part. Planes have half extents of 1, others are in mm. */
export function shapeOf(cut: CutDocument): { positions: number[]; triangles: number[]; outline: number[] } | undefined {
  if (cut.plane) {
    const [a, b] = [1, 1];
    return { positions: [-a, -b, 0, a, -b, 0, a, b, 0, -a, b, 0], triangles: [0, 1, 2, 0, 2, 3], outline: [0, 1, 1, 2, 2, 3, 3, 0] };
  }
  if (!cut.polyline) return undefined;
  const { points_mm, direction, depth_mm } = cut.polyline;
  const centre = new Vector3(...originalCentre(cut));
  const into = new Vector3().fromArray(direction).normalize().multiplyScalar(depth_mm);
  const near = points_mm.map((point) => new Vector3().fromArray(point).sub(centre));
  const positions = [...near, ...near.map((point) => point.clone().add(into))].flatMap((point) => point.toArray());
  const n = near.length;
  const edges = Array.from({ length: n - 1 }, (_, i) => i);
  const triangles = edges.flatMap((i) => [i, i + 1, n + i + 1, i, n + i + 1, n + i]);
  const outline = [...edges.flatMap((i) => [i, i + 1, n + i, n + i + 1]), 0, n, n - 1, 2 * n - 1];
  return { positions, triangles, outline };
}

function originalCentre(cut: CutDocument): Point {
  if (cut.plane) return cut.plane.point_mm as Point;
  const points = cut.polyline?.points_mm ?? (cut.free_part ? [cut.free_part.point_mm] : []);
  return [0, 1, 2].map((i) => points.reduce((sum, point) => sum + (point[i] ?? 0), 0) / Math.max(points.length, 1)) as Point;
}

function halfOf({ plane }: CutDocument): [number, number] | undefined {
  return plane?.bounds ? [plane.bounds.half_length_mm, plane.bounds.half_width_mm] : undefined;
}

function axesOf(cut: CutDocument): Quaternion {
  if (!cut.plane) return new Quaternion();
  const z = new Vector3().fromArray(cut.plane.normal).normalize();
  const across = Math.abs(z.x) < 0.9 ? new Vector3(1, 0, 0) : new Vector3(0, 1, 0);
  const given = cut.plane.bounds ? new Vector3().fromArray(cut.plane.bounds.direction) : across;
  const x = given.addScaledVector(z, -given.dot(z)).normalize();
  return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(x, z.clone().cross(x), z));
}

function rounded(value: number, parts: number): number {
  return Math.round(value * parts) / parts + 0;
}
