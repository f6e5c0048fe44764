import type { Schemas } from "./state.ts";

/** A point of a drawing, pixels from its top left corner. */
export type DrawnPoint = [number, number];

/** Profile lines of one or more predictions as a drawing, the nose to the right. */
export interface ProfileDrawing {
  width: number;
  height: number;
  pixelsPerMm: number;
  /** Lines of the skin at rest. */
  before: DrawnPoint[][];
  /** Lines at the end of the path, for each prediction. */
  after: DrawnPoint[][][];
  /** Places of the lines of a 10 mm grid. */
  columns: number[];
  rows: number[];
}

type Pieces = Schemas["ProfilePieceDocument"][];
type Yz = [number, number];

const MARGIN = 10;

/** Draws profiles into a width, pixels, at most `maxHeight` high. LPS: the nose points to -y, up is +z. */
export function drawProfiles(profiles: readonly Pieces[], width: number, maxHeight: number): ProfileDrawing | undefined {
  const before = (profiles[0] ?? []).map((piece) => piece.before_yz_mm as Yz[]);
  const after = profiles.map((pieces) => pieces.map((piece) => piece.after_yz_mm as Yz[]));
  const points = [...before, ...after.flat()].flat();
  if (points.length === 0) return undefined;
  const [left, right] = rangeOf(points.map(([y]) => -y));
  const [top, bottom] = rangeOf(points.map(([, z]) => -z));
  const pixelsPerMm = Math.min((width - 2 * MARGIN) / (right - left), (maxHeight - 2 * MARGIN) / (bottom - top));
  const x = (mm: number) => (mm - (left + right) / 2) * pixelsPerMm + width / 2;
  const y = (mm: number) => (mm - top) * pixelsPerMm + MARGIN;
  const height = y(bottom) + MARGIN;
  const drawn = (line: Yz[]): DrawnPoint[] => line.map(([py, pz]) => [x(-py), y(-pz)]);
  return {
    width,
    height,
    pixelsPerMm,
    before: before.map(drawn),
    after: after.map((lines) => lines.map(drawn)),
    columns: gridOf(left, right, (width / pixelsPerMm - (right - left)) / 2).map(x),
    rows: gridOf(top, bottom, MARGIN / pixelsPerMm).map(y),
  };
}

/** Largest movement of a profile's points, mm. */
export function largestMovement(pieces: Pieces): number {
  const movements = pieces.flatMap(({ before_yz_mm, after_yz_mm }) => {
    return before_yz_mm.map(([y = 0, z = 0], i) => Math.hypot((after_yz_mm[i]?.[0] ?? y) - y, (after_yz_mm[i]?.[1] ?? z) - z));
  });
  return movements.reduce((largest, movement) => Math.max(largest, movement), 0);
}

function rangeOf(values: number[]): [number, number] {
  return values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
}

/** Multiples of 10 mm in a range and the margin around it. */
function gridOf(from: number, to: number, margin: number): number[] {
  const first = Math.ceil((from - margin) / 10);
  const last = Math.floor((to + margin) / 10);
  return Array.from({ length: Math.max(last - first + 1, 0) }, (_, i) => 10 * (first + i));
}
