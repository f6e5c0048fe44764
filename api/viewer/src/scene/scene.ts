import { Box3, Vector3 } from "three";
import type { App } from "../actions/app.ts";
import { setMotion } from "../actions/cuts.ts";
import { moveDraftCut } from "../actions/draft.ts";
import { condylesOf } from "../model/state.ts";
import type { Prediction } from "../model/prediction.ts";
import type { State } from "../model/state.ts";
import { Bones } from "./bones.ts";
import { DraftPlanes } from "./draft-planes.ts";
import { Gizmo } from "./gizmo.ts";
import { LandmarkMarkers } from "./landmark-markers.ts";
import { Pointer } from "./pointer.ts";
import type { Hover } from "./pointer.ts";
import { Skin } from "./skin.ts";
import type { SkinMap } from "./skin.ts";
import { Stage } from "./stage.ts";
import type { ViewName } from "./views.ts";

/** What the scene reports to the page. */
export interface SceneListener {
  onHover: (hover: Hover | undefined) => void;
  /** Sides of the patient at the left and right edge of the picture. */
  onSides: (left: string, right: string) => void;
}

/** The picture of the state. */
export class FaceScene {
  readonly #stage: Stage;
  readonly #skin: Skin;
  readonly #second: Skin;
  readonly #bones: Bones;
  readonly #markers: LandmarkMarkers;
  readonly #gizmo: Gizmo;
  readonly #draft: DraftPlanes;

  constructor(app: App, canvas: HTMLCanvasElement, listener: SceneListener) {
    const stage = new Stage(canvas);
    stage.onSides = listener.onSides;
    this.#stage = stage;
    this.#skin = new Skin(stage.after, stage.before);
    this.#second = new Skin(stage.second);
    this.#bones = new Bones(stage);
    this.#markers = new LandmarkMarkers(stage);
    this.#gizmo = new Gizmo(stage, (motion) => {
      const { cut } = app.state;
      if (cut) setMotion(app, cut.selected, motion);
      if (app.state.display.t !== 1) app.display({ t: 1 });
    });
    this.#draft = new DraftPlanes(stage, (cut) => moveDraftCut(app, cut));
    const targets = {
      stage, skin: this.#skin, second: this.#second, bones: this.#bones, markers: this.#markers, draft: this.#draft,
      handles: [this.#gizmo.handle, this.#draft.handle],
    };
    new Pointer(app, targets, listener.onHover);
    app.store.subscribe((state) => this.#show(state));
  }

  setView(view: ViewName): void {
    this.#stage.setView(view);
  }

  orbit(leftDeg: number, upDeg: number, factor = 1): void {
    this.#stage.orbit(leftDeg, upDeg, factor);
  }

  #show(state: State): void {
    const { display, surfaces, cut, prediction, comparison, landmarks, draft } = state;
    const { t, skinOpacity: opacity } = display;
    // A face at a place that has not arrived stays at the last step; the bone stays with it.
    const shown = prediction ? Math.min(t, prediction.reach) : t;
    const second = comparison?.second;
    this.#skin.show({ surface: surfaces.skin, prediction, t: shown, opacity, map: mapOf(state, prediction, shown) });
    this.#second.show({ surface: undefined, prediction: second, t: shown, opacity, map: mapOf(state, second, shown) });
    this.#stage.setSplit(second !== undefined);
    this.#bones.show({ skull: surfaces.skull, cut, t: shown, opacity: display.boneOpacity, condyles: condylesOf(landmarks) });
    this.#markers.show(landmarks, display.landmarks);
    // Handles read the cursor as if there were one view; those of cuts come first.
    this.#draft.show(second ? undefined : draft);
    this.#gizmo.show(second || draft ? "off" : display.gizmo, cut?.motions.get(cut.selected));
    this.#stage.setBlend(display.blend);
    this.#frame(state);
    this.#stage.draw();
  }

  /** Puts the face into the standard views. */
  #frame({ surfaces }: State): void {
    const geometry = surfaces.skin?.geometry ?? surfaces.skull?.geometry;
    if (!geometry) return;
    geometry.boundingBox ??= new Box3().setFromBufferAttribute(geometry.getAttribute("position") as Parameters<Box3["setFromBufferAttribute"]>[0]);
    const box = geometry.boundingBox;
    this.#stage.setSubject(box.getCenter(new Vector3()), 0.56 * Math.max(...box.getSize(new Vector3()).toArray()));
  }
}

/** Colours of a prediction at path parameter `t`; `undefined` for plain skin. The distance between two colours the first. */
function mapOf(state: State, prediction: Prediction | undefined, t: number): SkinMap | undefined {
  const { colour: name } = state.display;
  const scale = name === "none" ? undefined : state.scales[name];
  if (!prediction || name === "none" || !scale) return undefined;
  const { comparison } = state;
  const distance = name === "distance" && comparison?.first === prediction ? comparison.distanceAt(t) : undefined;
  const values = name === "distance" ? distance : prediction.scalarAt(name, t);
  return values && { values, name, scale };
}
