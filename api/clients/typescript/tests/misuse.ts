// Programs that must not compile. `npm run check` fails where one does.
import type { components } from "../src/openapi.ts";
import type { Problem } from "../src/problem.ts";

type Schemas = components["schemas"];
type Plane = Schemas["PlaneDocument"];
type Line = Schemas["PolylineDocument"];

export function misuse(job: Schemas["JobView"], problem: Problem, plane: Plane, polyline: Line): unknown[] {
  // @ts-expect-error misspelt status
  const status = job.status === "suceeded";
  // @ts-expect-error misspelt kind of a problem
  const kind = problem.kind === "missing-inputs";
  // @ts-expect-error misspelt code of a finding
  const finding: Schemas["WarningDocument"] = { code: "wide-gaps", severity: "check", message: "" };
  // @ts-expect-error misspelt state of a part
  const part: Schemas["PartView"] = { state: "redy", bytes: 1 };
  // @ts-expect-error no shape
  const noCut: Schemas["CutDocument"] = {};
  // @ts-expect-error two shapes
  const twoCuts: Schemas["CutDocument"] = { plane, polyline };
  // @ts-expect-error neither cuts nor a template
  const noCuts: Schemas["CreateOsteotomy"] = { label: "left" };
  // @ts-expect-error none of the three forms
  const noRotation: Schemas["RotationRequest"] = { pivot_mm: [0, 0, 0] };
  // @ts-expect-error neither waypoints nor autorotation
  const noPath: Schemas["PathRequest"] = { segment: 1 };
  // @ts-expect-error a hinge beside a translation
  const twoMotions: Schemas["WaypointRequest"] = { t: 1, hinge: { angle_deg: 2 }, translation_mm: [0, 0, 0] };
  // @ts-expect-error a job without its step
  const noSurface: Schemas["SurfaceRef"] = { job: "" };
  return [noSurface, status, kind, finding, part, noCut, twoCuts, noCuts, noRotation, noPath, twoMotions];
}
