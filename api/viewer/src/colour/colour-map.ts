import type { ScalarName } from "../model/prediction.ts";

/** A colour map: of the values of one prediction, or of the distance between two. */
export type MapName = ScalarName | "distance";

/** Linear range of values, mm, of a colour map. */
export interface Scale {
  min: number;
  max: number;
}

/**
 * Nine evenly spaced colours of viridis, sRGB.
 *
 * Source: Smith and van der Walt, matplotlib 2.0 (2015).
 */
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];

/** Blue, white, orange: lightness falls evenly on both sides of zero, and red-green blindness keeps the two hues apart. */
const BLUE_WHITE_ORANGE = ["#08306b", "#2171b5", "#6baed6", "#c6dbef", "#f7f7f7", "#fdd0a2", "#fd8d3c", "#d94801", "#7f2704"];

/** Vertices without a value: no reference lies there. */
const NO_VALUE = "#9a9a9a";

const ENTRIES = 256;

type Rgb = [number, number, number];

/** Table of 256 linear RGB colours; the last entry beyond is the colour of vertices without a value. */
function table(stops: string[]): Float32Array {
  const colours = stops.map(linearRgb);
  const entries = new Float32Array(3 * (ENTRIES + 1));
  for (let i = 0; i < ENTRIES; i += 1) {
    const at = (i / (ENTRIES - 1)) * (colours.length - 1);
    const below = Math.min(Math.floor(at), colours.length - 2);
    const [a, b] = [colours[below] as Rgb, colours[below + 1] as Rgb];
    for (let c = 0; c < 3; c += 1) entries[3 * i + c] = (a[c] as number) + (at - below) * ((b[c] as number) - (a[c] as number));
  }
  entries.set(linearRgb(NO_VALUE), 3 * ENTRIES);
  return entries;
}

function linearRgb(hex: string): Rgb {
  const channel = (from: number) => {
    const value = Number.parseInt(hex.slice(from, from + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  };
  return [channel(1), channel(3), channel(5)];
}

const SEQUENTIAL = table(VIRIDIS);
const TABLES: Record<MapName, Float32Array> = { displacement: SEQUENTIAL, distance: SEQUENTIAL, error: table(BLUE_WHITE_ORANGE) };

/** Writes the linear RGB colour of each value into `out`. */
export function colourValues(values: Float32Array, name: MapName, scale: Scale, out: Float32Array): void {
  const entries = TABLES[name];
  const perMm = (ENTRIES - 1) / Math.max(scale.max - scale.min, 1e-6);
  for (let i = 0; i < values.length; i += 1) {
    const value = values[i] as number;
    const at = Number.isFinite(value) ? Math.round(Math.min(Math.max((value - scale.min) * perMm, 0), ENTRIES - 1)) : ENTRIES;
    out[3 * i] = entries[3 * at] as number;
    out[3 * i + 1] = entries[3 * at + 1] as number;
    out[3 * i + 2] = entries[3 * at + 2] as number;
  }
}

/** Round range that holds nearly all values: from 0 for displacement and distance, symmetric about 0 for errors. */
export function scaleOf(values: Float32Array, name: MapName): Scale {
  const sizes = Array.from(values, Math.abs).filter(Number.isFinite).sort((a, b) => a - b);
  // Errors at borders may be tens of mm; the 99th percentile keeps the map readable.
  const largest = (name === "error" ? sizes[Math.ceil(0.99 * (sizes.length - 1))] : sizes.at(-1)) ?? 0;
  const max = roundUp(largest);
  return { min: name === "error" ? -max : 0, max };
}

function roundUp(value: number): number {
  if (value <= 0.1) return 0.1;
  const power = 10 ** Math.floor(Math.log10(value));
  const step = [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((factor) => factor * power >= value - 1e-9) ?? 10;
  return Number((step * power).toPrecision(3));
}

/** Five values at which the legend is labelled. */
export function ticksOf(scale: Scale): number[] {
  return [0, 0.25, 0.5, 0.75, 1].map((share) => scale.min + share * (scale.max - scale.min));
}
