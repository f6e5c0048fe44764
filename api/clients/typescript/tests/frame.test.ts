import { expect, test } from "vitest";
import { decodeFrame, decodeTopology } from "../src/index.ts";

const floats = (...values: number[]) => Float32Array.from(values).buffer;

test("a frame has positions, then displacements", () => {
  const frame = decodeFrame(floats(1, 2, 3, 4, 5, 6, 0.5, 0.25), 2);
  expect([...frame.positions]).toEqual([1, 2, 3, 4, 5, 6]);
  expect([...frame.displacementMm]).toEqual([0.5, 0.25]);
  expect(frame.errorMm).toBeUndefined();
});

test("a frame with an error map has errors after the displacements", () => {
  const frame = decodeFrame(floats(1, 2, 3, 0.5, -1.5), 1);
  expect([...(frame.errorMm ?? [])]).toEqual([-1.5]);
});

test("a frame of another skin is refused", () => {
  expect(() => decodeFrame(floats(1, 2, 3, 4, 5), 2)).toThrow("a frame of 2 vertices has 32 or 40 bytes, found 20");
});

test("a topology has three vertex numbers for each triangle", () => {
  expect([...decodeTopology(Uint32Array.of(0, 1, 2, 2, 1, 3).buffer)]).toEqual([0, 1, 2, 2, 1, 3]);
  expect(() => decodeTopology(new ArrayBuffer(8))).toThrow("12 bytes");
});
