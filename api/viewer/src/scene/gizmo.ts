import { Vector3 } from "three";
import { rotationOf, translationOf, withHandle } from "../model/motion.ts";
import type { Motion } from "../model/motion.ts";
import type { GizmoMode } from "../model/state.ts";
import { Handle } from "./handle.ts";
import type { Stage } from "./stage.ts";

/** Names of the axes, LPS. Planes and the centre move freely. */
const HINTS = {
  translate: { X: "left – right", Y: "forward – back", Z: "up – down" },
  rotate: { X: "pitch", Y: "roll", Z: "yaw" },
};

/** Handle at the pivot of a segment: dragging it changes the segment's motion. */
export class Gizmo {
  readonly handle: Handle;
  #motion: Motion | undefined;

  constructor(stage: Stage, onMotion: (motion: Motion) => void) {
    this.handle = new Handle(stage, HINTS, (position, rotation) => {
      if (!this.#motion) return;
      this.#motion = withHandle(this.#motion, position, rotation);
      onMotion(this.#motion);
    });
  }

  show(mode: GizmoMode, motion: Motion | undefined): void {
    const usable = motion !== undefined && (motion.kind === "free" || motion.kind === "rest");
    this.#motion = mode !== "off" && usable ? motion : undefined;
    if (mode === "off" || !this.#motion) return this.handle.show(undefined);
    const position = new Vector3(...this.#motion.pivot).add(translationOf(this.#motion));
    this.handle.show({ mode, space: "world", position, rotation: rotationOf(this.#motion) });
  }
}
