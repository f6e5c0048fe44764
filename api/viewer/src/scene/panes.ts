/** A part of the canvas, CSS pixels from its top left corner. */
export interface Pane {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** Parts of the canvas: one; or two beside each other, on upright canvases one below the other. `style.css` places their captions alike. */
export function panesOf(width: number, height: number, isSplit: boolean): Pane[] {
  if (!isSplit) return [{ x: 0, y: 0, width, height }];
  if (width > height) {
    const half = width / 2;
    return [{ x: 0, y: 0, width: half, height }, { x: half, y: 0, width: half, height }];
  }
  const half = height / 2;
  return [{ x: 0, y: 0, width, height: half }, { x: 0, y: half, width, height: half }];
}

/** Number of the pane at a point of the canvas, CSS pixels. */
export function paneAt(panes: readonly Pane[], x: number, y: number): number {
  return panes.findLastIndex((pane) => x >= pane.x && y >= pane.y);
}

/** A point of the canvas, CSS pixels, in normalised device coordinates of a pane. */
export function inPane(pane: Pane, x: number, y: number): [number, number] {
  return [(2 * (x - pane.x)) / pane.width - 1, 1 - (2 * (y - pane.y)) / pane.height];
}
