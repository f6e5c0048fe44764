import { Object3D, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { rotationOf, translationOf, withHandle } from "../model/motion.ts";
import type { Motion } from "../model/motion.ts";
import type { GizmoMode } from "../model/state.ts";
import type { Stage } from "./stage.ts";

/** Handle at the pivot of a segment: dragging it changes the segment's motion. */
export class Gizmo {
  readonly #controls: TransformControls;
  readonly #handle = new Object3D();
  readonly #helper: Object3D;
  #motion: Motion | undefined;

  constructor(stage: Stage, onMotion: (motion: Motion) => void) {
    this.#controls = new TransformControls(stage.camera, stage.canvas);
    this.#controls.size = 0.7;
    this.#helper = this.#controls.getHelper();
    stage.common.add(this.#handle, this.#helper);
    this.#controls.addEventListener("change", () => stage.draw());
    this.#controls.addEventListener("dragging-changed", (event) => {
      stage.controls.enabled = event.value !== true;
    });
    this.#controls.addEventListener("objectChange", () => {
      if (!this.#motion) return;
      this.#motion = withHandle(this.#motion, this.#handle.position, this.#handle.quaternion);
      onMotion(this.#motion);
    });
  }

  /** Whether the cursor is on the handle or drags it. */
  get active(): boolean {
    return this.#controls.dragging || this.#controls.axis !== null;
  }

  show(mode: GizmoMode, motion: Motion | undefined): void {
    const usable = motion !== undefined && (motion.kind === "free" || motion.kind === "rest");
    if (mode === "off" || !usable) {
      this.#motion = undefined;
      this.#controls.detach();
      return;
    }
    this.#controls.setMode(mode);
    // While it is dragged the handle leads; the rounded numbers follow.
    if (!this.#controls.dragging) {
      this.#handle.position.copy(new Vector3(...motion.pivot).add(translationOf(motion)));
      this.#handle.quaternion.copy(rotationOf(motion));
    }
    this.#motion = motion;
    this.#controls.attach(this.#handle);
  }
}
