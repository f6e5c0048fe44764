import type { Comparison } from "../model/comparison.ts";
import type { Prediction } from "../model/prediction.ts";
import { scaleOf } from "./colour-map.ts";
import type { MapName, Scale } from "./colour-map.ts";

/** Ranges of the colour maps of a prediction; two predictions side by side share them. */
export function mapScales(first: Prediction, comparison: Comparison | undefined): Partial<Record<MapName, Scale>> {
  const shown = comparison?.first === first ? [first, comparison.second] : [first];
  const frames = shown.map((prediction) => prediction.last.frame);
  const scales: Partial<Record<MapName, Scale>> = {};
  const displacement = frames.map(({ displacementMm }) => scaleOf(displacementMm, "displacement"));
  const error = frames.flatMap(({ errorMm }) => (errorMm ? [scaleOf(errorMm, "error")] : []));
  const distances = comparison?.first === first ? comparison.distanceAt(1) : undefined;
  scales.displacement = widest(displacement);
  if (error.length > 0) scales.error = widest(error);
  if (distances) scales.distance = scaleOf(distances, "distance");
  return scales;
}

function widest(scales: Scale[]): Scale {
  return { min: Math.min(...scales.map(({ min }) => min)), max: Math.max(...scales.map(({ max }) => max)) };
}
