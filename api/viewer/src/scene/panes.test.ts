import { expect, test } from "vitest";
import { inPane, paneAt, panesOf } from "./panes.ts";

test("two views lie beside each other, on upright canvases one below the other", () => {
  expect(panesOf(800, 600, false)).toEqual([{ x: 0, y: 0, width: 800, height: 600 }]);
  expect(panesOf(800, 600, true)[1]).toEqual({ x: 400, y: 0, width: 400, height: 600 });
  expect(panesOf(390, 680, true)[1]).toEqual({ x: 0, y: 340, width: 390, height: 340 });
});

test("the same place of both views has the same coordinates", () => {
  const panes = panesOf(800, 600, true);
  expect([paneAt(panes, 399, 10), paneAt(panes, 400, 10)]).toEqual([0, 1]);
  expect(inPane(panes[0]!, 300, 150)).toEqual([0.5, 0.5]);
  expect(inPane(panes[1]!, 700, 150)).toEqual([0.5, 0.5]);
});
