import { Box3, Vector3 } from "three";
import type { App } from "../actions/app.ts";
import { setMotion } from "../actions/cuts.ts";
import { condylesOf } from "../model/state.ts";
import type { State } from "../model/state.ts";
import { Bones } from "./bones.ts";
import { Gizmo } from "./gizmo.ts";
import { LandmarkMarkers } from "./landmark-markers.ts";
import { Pointer } from "./pointer.ts";
import type { Hover } from "./pointer.ts";
import { Skin } from "./skin.ts";
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
  readonly #bones: Bones;
  readonly #markers: LandmarkMarkers;
  readonly #gizmo: Gizmo;

  constructor(app: App, canvas: HTMLCanvasElement, listener: SceneListener) {
    const stage = new Stage(canvas);
    stage.onSides = listener.onSides;
    this.#stage = stage;
    this.#skin = new Skin(stage);
    this.#bones = new Bones(stage);
    this.#markers = new LandmarkMarkers(stage);
    this.#gizmo = new Gizmo(stage, (motion) => {
      const { cut } = app.state;
      if (cut) setMotion(app, cut.selected, motion);
      if (app.state.display.t !== 1) app.display({ t: 1 });
    });
    const targets = { stage, skin: this.#skin, bones: this.#bones, markers: this.#markers, gizmo: this.#gizmo };
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
    const { display, surfaces, cut, prediction, landmarks } = state;
    const { t, colour } = display;
    // A face at a place that has not arrived stays at the last step; the bone stays with it.
    const shown = prediction ? Math.min(t, prediction.reach) : t;
    const scale = colour === "none" ? undefined : state.scales[colour];
    this.#skin.show({ surface: surfaces.skin, prediction, t: shown, opacity: display.skinOpacity, colour, scale });
    this.#bones.show({ skull: surfaces.skull, cut, t: shown, opacity: display.boneOpacity, condyles: condylesOf(landmarks) });
    this.#markers.show(landmarks, display.landmarks);
    this.#gizmo.show(display.gizmo, cut?.motions.get(cut.selected));
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
