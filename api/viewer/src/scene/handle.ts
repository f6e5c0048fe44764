import { Object3D, Vector3 } from "three";
import type { Quaternion } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { RingDrag } from "./ring-drag.ts";
import type { Stage } from "./stage.ts";

/** What a handle moves along or turns about: the axes of LPS, or those of what it moves. */
export interface HandleView {
  mode: "translate" | "rotate";
  space: "world" | "local";
  position: Vector3;
  rotation: Quaternion;
  /** Whether only the local z axis can be dragged. */
  zOnly?: boolean;
}

/** Words for each axis, by mode. */
type Hints = Record<"translate" | "rotate", Record<string, string>>;

/** Arrows or rings in the picture that the pointer drags. */
export class Handle {
  readonly #controls: TransformControls;
  readonly #object = new Object3D();
  readonly #hints: Hints;
  readonly #stage: Stage;
  #ring: RingDrag | undefined;
  #cursor: [number, number] = [0, 0];

  /** `hints` says what each axis does; `onChange` gets the place to which it was dragged. */
  constructor(stage: Stage, hints: Hints, onChange: (position: Vector3, rotation: Quaternion) => void) {
    this.#hints = hints;
    this.#stage = stage;
    // Before the listeners of the controls, which read the ring at the same event.
    for (const type of ["pointerdown", "pointermove"] as const) {
      stage.canvas.addEventListener(type, ({ clientX, clientY }) => (this.#cursor = stage.locate(clientX, clientY).at), { capture: true });
    }
    this.#controls = new TransformControls(stage.camera, stage.canvas);
    this.#controls.size = 0.7;
    stage.common.add(this.#object, this.#controls.getHelper());
    this.#controls.addEventListener("change", () => {
      stage.canvas.style.cursor = this.active ? "move" : "";
      stage.draw();
    });
    this.#controls.addEventListener("dragging-changed", (event) => {
      stage.controls.enabled = event.value !== true;
      this.#ring = event.value === true ? this.#grabbedRing() : undefined;
    });
    this.#controls.addEventListener("objectChange", () => {
      const turned = this.#ring?.rotationAt(this.#cursor, stage.camera);
      if (turned) this.#object.quaternion.copy(turned);
      onChange(this.#object.position, this.#object.quaternion);
    });
  }

  /** Whether the cursor is on the handle or drags it. */
  get active(): boolean {
    return this.#controls.dragging || this.#controls.axis !== null;
  }

  /** What dragging the part under the cursor does. */
  get hint(): string | undefined {
    const { axis, mode } = this.#controls;
    return axis === null || mode === "scale" ? undefined : this.#hints[mode][axis];
  }

  show(view: HandleView | undefined): void {
    if (!view) {
      this.#controls.detach();
      return;
    }
    this.#controls.setMode(view.mode);
    this.#controls.setSpace(view.space);
    this.#controls.showX = this.#controls.showY = view.zOnly !== true;
    // While it is dragged the handle leads; the rounded numbers follow.
    if (!this.#controls.dragging) {
      this.#object.position.copy(view.position);
      this.#object.quaternion.copy(view.rotation);
    }
    this.#controls.attach(this.#object);
  }

  /** The ring that the cursor has just taken. */
  #grabbedRing(): RingDrag | undefined {
    const { axis, mode, space } = this.#controls;
    if (mode !== "rotate" || axis === null || !["X", "Y", "Z"].includes(axis)) return undefined;
    const direction = new Vector3(Number(axis === "X"), Number(axis === "Y"), Number(axis === "Z"));
    if (space === "local") direction.applyQuaternion(this.#object.quaternion);
    const ring = new RingDrag(direction, this.#object.quaternion, this.#object.position);
    ring.rotationAt(this.#cursor, this.#stage.camera);
    return ring;
  }
}
