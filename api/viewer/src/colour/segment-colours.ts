/**
 * Colours of segments by number; the fixed segment 0 has that of bone. `style.css` has the same ones as `.swatch-0` and so on.
 *
 * Source: Okabe and Ito, *Color Universal Design* (2008): colour-blind readers tell them apart.
 */
export const SEGMENT_COLOURS = ["#e6dcc6", "#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#0072b2", "#d55e00"];
