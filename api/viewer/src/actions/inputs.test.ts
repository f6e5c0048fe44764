import { expect, test } from "vitest";
import { roleOf } from "./inputs.ts";

test("the name of a file tells what it is", () => {
  const roles = ["head.nii.gz", "series.zip", "skin.stl", "Skull.PLY", "post_op_skin.obj", "landmarks.json"].map(roleOf);
  expect(roles).toEqual(["ct", "ct", "skin", "skull", "target", "landmarks"]);
});

test("a surface without a telling name is asked for", () => {
  expect(roleOf("mesh1.stl")).toBeUndefined();
  expect(roleOf("notes.txt")).toBeUndefined();
});
