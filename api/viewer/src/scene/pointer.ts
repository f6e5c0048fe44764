import { Raycaster, Vector2 } from "three";
import { moveLandmark, selectLandmark } from "../actions/landmarks.ts";
import { selectSegment } from "../actions/cuts.ts";
import { changeDraft } from "../actions/draft.ts";
import type { Draft } from "../model/draft.ts";
import type { App } from "../actions/app.ts";
import type { Point } from "../model/motion.ts";
import type { Bones } from "./bones.ts";
import type { DraftPlanes } from "./draft-planes.ts";
import type { Handle } from "./handle.ts";
import type { LandmarkMarkers } from "./landmark-markers.ts";
import type { Skin } from "./skin.ts";
import type { Stage } from "./stage.ts";

/** What lies under the cursor. */
export interface Hover {
  x: number;
  y: number;
  text: string;
}

/** A press that moves less than this is a click, pixels. */
const CLICK_PX = 4;

/** Parts of the scene that the pointer works on. */
export interface Targets {
  stage: Stage;
  skin: Skin;
  /** Skin of the second view. */
  second: Skin;
  bones: Bones;
  markers: LandmarkMarkers;
  draft: DraftPlanes;
  handles: Handle[];
}

/** Drags landmarks, chooses segments, and reads the value under the cursor. */
export class Pointer {
  readonly #app: App;
  readonly #targets: Targets;
  readonly #onHover: (hover: Hover | undefined) => void;
  readonly #raycaster = new Raycaster();
  #dragging: { name: string; from: Point } | undefined;
  #pressed: { x: number; y: number } | undefined;
  #moved: PointerEvent | undefined;

  constructor(app: App, targets: Targets, onHover: (hover: Hover | undefined) => void) {
    this.#app = app;
    this.#targets = targets;
    this.#onHover = onHover;
    const { canvas } = targets.stage;
    // Before OrbitControls, so that a dragged landmark does not turn the camera.
    canvas.addEventListener("pointerdown", (event) => this.#press(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#release(event));
    // A finger that is lifted leaves the picture; the value that it tapped stays until the next touch.
    canvas.addEventListener("pointerleave", ({ pointerType }) => {
      if (pointerType !== "touch") onHover(undefined);
    });
  }

  #press(event: PointerEvent): void {
    this.#pressed = { x: event.clientX, y: event.clientY };
    if (event.pointerType === "touch") this.#onHover(undefined);
    if (this.#handle) return;
    if (this.#aim(event) !== 0) return;
    const name = this.#targets.markers.pick(this.#raycaster);
    const from = name === undefined ? undefined : this.#app.state.landmarks?.document.points[name];
    if (name === undefined || !from) return;
    this.#dragging = { name, from: from as Point };
    this.#targets.stage.controls.enabled = false;
    this.#targets.stage.canvas.setPointerCapture(event.pointerId);
    selectLandmark(this.#app, name);
  }

  /** Rays through 100 000 triangles take milliseconds, so one ray an animation frame. */
  #move(event: PointerEvent): void {
    if (this.#moved === undefined) requestAnimationFrame(() => this.#handleMove());
    this.#moved = event;
  }

  #handleMove(): void {
    const event = this.#moved;
    this.#moved = undefined;
    if (!event) return;
    if (this.#dragging) this.#drag(event);
    else if (event.buttons === 0) this.#hover(event);
  }

  #drag(event: PointerEvent): void {
    const { skin, bones, markers } = this.#targets;
    if (!this.#dragging || !this.#hasMoved(event)) return;
    // A landmark of the first view cannot be dragged into the second.
    if (this.#aim(event) !== 0) return;
    const surfaces = [skin.mesh, ...bones.meshes].filter((mesh) => mesh.visible);
    const place = markers.dragged(this.#raycaster, this.#dragging.from, surfaces);
    if (place) moveLandmark(this.#app, this.#dragging.name, place);
  }

  #release(event: PointerEvent): void {
    const clicked = !this.#hasMoved(event);
    this.#pressed = undefined;
    if (this.#dragging) {
      this.#dragging = undefined;
      this.#targets.stage.controls.enabled = true;
    } else if (clicked && !this.#handle) {
      this.#choose(event);
    }
    if (clicked && event.pointerType === "touch") this.#hover(event);
  }

  #choose(event: PointerEvent): void {
    if (this.#aim(event) !== 0) return;
    const { draft } = this.#app.state;
    if (draft) return this.#chooseCut(draft);
    const moving = this.#targets.bones.moving;
    const hit = this.#raycaster.intersectObjects(moving.map(([, mesh]) => mesh), false)[0];
    const segment = moving.find(([, mesh]) => mesh === hit?.object)?.[0];
    if (segment !== undefined) selectSegment(this.#app, segment);
  }

  #chooseCut(draft: Draft): void {
    const meshes = this.#targets.draft.meshesOf(draft);
    const hit = this.#raycaster.intersectObjects(meshes.map(([, mesh]) => mesh), false)[0];
    const selected = meshes.find(([, mesh]) => mesh === hit?.object)?.[0];
    if (selected !== undefined) changeDraft(this.#app, { selected });
  }

  /** The handle that is under the cursor or dragged. */
  get #handle(): Handle | undefined {
    return this.#targets.handles.find(({ active }) => active);
  }

  #hover(event: PointerEvent): void {
    const { skin, second, markers } = this.#targets;
    const view = this.#aim(event);
    const landmark = view === 1 ? undefined : markers.pick(this.#raycaster);
    const value = () => (landmark === undefined ? this.#valueText(view === 1 ? second : skin) : landmarkText(this.#app, landmark));
    const text = this.#handle ? this.#handle.hint : value();
    const box = this.#targets.stage.canvas.getBoundingClientRect();
    this.#onHover(text === undefined ? undefined : { x: event.clientX - box.left, y: event.clientY - box.top, text });
  }

  #valueText(skin: Skin): string | undefined {
    const { colour } = this.#app.state.display;
    if (colour === "none" || !skin.isColoured) return undefined;
    const hit = this.#raycaster.intersectObject(skin.mesh, false)[0];
    if (!hit?.face) return undefined;
    const { a, b, c } = hit.face;
    const value = skin.valueAt([a, b, c], hit.barycoord?.toArray() ?? []);
    if (value === undefined) return "no value";
    return `${colour === "error" && value > 0 ? "+" : ""}${value.toFixed(2).replace("-", "−")} mm`;
  }

  /** Aims at what lies under the cursor; returns the number of the view. */
  #aim(event: PointerEvent): number {
    const { stage } = this.#targets;
    const { at, view } = stage.locate(event.clientX, event.clientY);
    this.#raycaster.setFromCamera(new Vector2(...at), stage.camera);
    return view;
  }

  #hasMoved(event: PointerEvent): boolean {
    const { x, y } = this.#pressed ?? { x: event.clientX, y: event.clientY };
    return Math.hypot(event.clientX - x, event.clientY - y) > CLICK_PX;
  }
}

function landmarkText(app: App, name: string): string {
  const document = app.state.landmarks?.document;
  if (!document?.proposed?.includes(name)) return name;
  const within = document.proposed_within_mm?.[name];
  return within === undefined ? `${name}, proposed` : `${name}, proposed within ${within} mm`;
}
