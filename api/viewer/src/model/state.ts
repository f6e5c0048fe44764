import type { components, JobView, ProblemField } from "@prosopon/client";
import type { BufferGeometry } from "three";
import type { MapName, Scale } from "../colour/colour-map.ts";
import type { Comparison } from "./comparison.ts";
import type { Draft, TemplateView } from "./draft.ts";
import type { Motion, Point } from "./motion.ts";
import type { Prediction } from "./prediction.ts";

export type Schemas = components["schemas"];
export type SessionView = Schemas["SessionView"];
export type OsteotomyView = Schemas["OsteotomyView"];
export type PlanView = Schemas["PlanView"];

/** What a dropped file is. */
export type FileRole = "ct" | "skin" | "skull" | "target" | "landmarks";

/** A dropped file on its way to the service. */
export interface Upload {
  id: number;
  file: File;
  /** `undefined` until the user has chosen what the file is. */
  role: FileRole | undefined;
  state: "waiting" | "sending" | "reading" | "done" | "failed";
  sent: number;
}

/** A surface in the scene; `key` changes with its content. */
export interface Surface {
  key: string;
  geometry: BufferGeometry;
}

/** Landmarks as shown, with the user's changes. */
export interface Landmarks {
  document: Schemas["LandmarksDocument"];
  /** Whether the service has not stored the shown landmarks. */
  changed: boolean;
  selected: string | undefined;
}

/** An osteotomy in the scene with the planned motion of each moving segment. */
export interface Cut {
  view: OsteotomyView;
  surfaces: Map<number, BufferGeometry>;
  motions: Map<number, Motion>;
  /** Plan that has been made of `motions`; absent after a change. */
  plan: PlanView | undefined;
  selected: number;
}

/** A problem as the page shows it. */
export interface ShownProblem {
  id: number;
  /** What the page was doing. */
  during: string;
  title: string;
  detail: string;
  faults: readonly ProblemField[];
  requestId: string | undefined;
}

export type ColourMode = "none" | MapName;
export type GizmoMode = "off" | "translate" | "rotate";
export type Theme = "auto" | "light" | "dark";

/** Settings of the picture. */
export interface Display {
  /** Path parameter, 0 to 1. */
  t: number;
  playing: boolean;
  /** 0 shows the face before, 1 the predicted face. */
  blend: number;
  skinOpacity: number;
  boneOpacity: number;
  landmarks: boolean;
  colour: ColourMode;
  gizmo: GizmoMode;
}

/** Settings of the next solve, as typed; empty fields take the service's default. */
export interface SolveForm {
  steps: string;
  edgeMm: string;
  model: string;
  referenceJob: string;
}

export interface State {
  /** Bearer token; never stored. */
  token: string;
  /** Whether the service has refused a request for want of a valid token. */
  needsToken: boolean;
  theme: Theme;
  sessions: readonly SessionView[];
  moreSessions: string | undefined;
  session: SessionView | undefined;
  uploads: readonly Upload[];
  /** Jobs of the session, the newest first. */
  jobs: readonly JobView[];
  surfaces: Partial<Record<"skin" | "skull" | "target", Surface>>;
  landmarks: Landmarks | undefined;
  /** Landmarks that each template needs; empty until they are known. */
  templates: readonly TemplateView[];
  /** Cuts that are shown before the bone is cut. */
  draft: Draft | undefined;
  osteotomies: readonly OsteotomyView[];
  cut: Cut | undefined;
  /** Job whose prediction is shown, or is being loaded. */
  shownSolve: string | undefined;
  prediction: Prediction | undefined;
  /** Job whose prediction is shown beside, or is being loaded for that. */
  comparedSolve: string | undefined;
  comparison: Comparison | undefined;
  /** Ranges of the colour maps of the shown predictions. */
  scales: Partial<Record<MapName, Scale>>;
  /** Clinical part of the reports, by job. */
  profiles: ReadonlyMap<string, Schemas["ClinicalDocument"]>;
  solve: SolveForm;
  display: Display;
  /** Work for which the user waits, by name. */
  busy: readonly string[];
  problems: readonly ShownProblem[];
  /** Whether the service does not answer. */
  interrupted: boolean;
}

export const INITIAL: State = {
  token: "",
  needsToken: false,
  theme: "auto",
  sessions: [],
  moreSessions: undefined,
  session: undefined,
  uploads: [],
  jobs: [],
  surfaces: {},
  landmarks: undefined,
  templates: [],
  draft: undefined,
  osteotomies: [],
  cut: undefined,
  shownSolve: undefined,
  prediction: undefined,
  comparedSolve: undefined,
  comparison: undefined,
  scales: {},
  profiles: new Map(),
  solve: { steps: "", edgeMm: "", model: "", referenceJob: "" },
  display: {
    t: 1, playing: false, blend: 1, skinOpacity: 1, boneOpacity: 1, landmarks: true, colour: "none", gizmo: "off",
  },
  busy: [],
  problems: [],
  interrupted: false,
};

/** What a session holds; a change of session begins with this. */
export const NO_SESSION = {
  session: undefined,
  uploads: [],
  jobs: [],
  surfaces: {},
  landmarks: undefined,
  draft: undefined,
  osteotomies: [],
  cut: undefined,
  shownSolve: undefined,
  prediction: undefined,
  comparedSolve: undefined,
  comparison: undefined,
  scales: {},
  profiles: new Map(),
  interrupted: false,
  display: INITIAL.display,
} satisfies Partial<State>;

/** State of a part of a session: `missing`, `building`, `ready`, `stale` or `failed`. */
export function partState(session: SessionView | undefined, part: string): string {
  return session?.parts[part]?.state ?? "missing";
}

/** Whether nobody has confirmed a condyle. */
export function areCondylesProposed(landmarks: Landmarks | undefined): boolean {
  return landmarks?.document.proposed?.some((name) => name.startsWith("condylion_")) === true;
}

/** Points of the condyles, right and left, when both are known. */
export function condylesOf(landmarks: Landmarks | undefined): [Point, Point] | undefined {
  const points = landmarks?.document.points;
  const [right, left] = [points?.["condylion_right"], points?.["condylion_left"]];
  return right && left ? [right as Point, left as Point] : undefined;
}
