import { BufferGeometry, DoubleSide, Float32BufferAttribute, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, Vector3 } from "three";
import { extentOf, isMovable, isPlane, rotationOf, shapeOf, withPose } from "../model/draft.ts";
import type { CutDocument, Draft, DraftCut } from "../model/draft.ts";
import { Handle } from "./handle.ts";
import type { Stage } from "./stage.ts";

/** Cuts by a saw, and cuts that only separate bone. The third one is selected. */
const COLOURS = { osteotomy: "#d55e00", separation: "#6d7787", selected: "#0072b2" };

const HINTS = {
  translate: { X: "left – right", Y: "forward – back", Z: "along the normal" },
  rotate: { X: "about its length", Y: "about its width", Z: "in its plane" },
};

/** Cuts before the bone is cut: translucent planes and sheets, and a handle at the selected one. */
export class DraftPlanes {
  readonly handle: Handle;
  readonly #stage: Stage;
  #meshes = new Map<CutDocument, Mesh<BufferGeometry, MeshBasicMaterial>>();
  #selected: DraftCut | undefined;

  constructor(stage: Stage, onMove: (cut: DraftCut) => void) {
    this.#stage = stage;
    this.handle = new Handle(stage, HINTS, (position, rotation) => {
      if (this.#selected) onMove((this.#selected = withPose(this.#selected, position, rotation)));
    });
  }

  /** Meshes by index of the cut, for choosing one by a click. */
  meshesOf(draft: Draft): [number, Mesh][] {
    return draft.cuts.flatMap(({ original }, i) => {
      const mesh = this.#meshes.get(original);
      return mesh ? [[i, mesh] as [number, Mesh]] : [];
    });
  }

  show(draft: Draft | undefined): void {
    const cuts = draft?.cuts ?? [];
    for (const [original, mesh] of this.#meshes) {
      if (cuts.some((cut) => cut.original === original)) continue;
      mesh.removeFromParent();
      mesh.geometry.dispose();
      this.#meshes.delete(original);
    }
    for (const [i, cut] of cuts.entries()) this.#place(cut, i === draft?.selected);
    const selected = draft?.cuts[draft.selected];
    this.#selected = selected && isMovable(selected) && draft?.handle !== "off" ? selected : undefined;
    if (!draft || draft.handle === "off" || !this.#selected) return this.handle.show(undefined);
    const zOnly = isPlane(this.#selected) && draft.handle === "translate";
    const mode = isPlane(this.#selected) ? draft.handle : "translate";
    const position = new Vector3(...this.#selected.centre);
    this.handle.show({ mode, space: "local", position, rotation: rotationOf(this.#selected), zOnly });
  }

  #place(cut: DraftCut, isSelected: boolean): void {
    const mesh = this.#meshes.get(cut.original) ?? this.#add(cut.original);
    if (!mesh) return;
    mesh.position.set(...cut.centre);
    mesh.quaternion.copy(rotationOf(cut));
    mesh.scale.set(...extentOf(cut), 1);
    const colour = isSelected ? COLOURS.selected : COLOURS[cut.original.purpose ?? "osteotomy"];
    mesh.material.color.set(colour);
    mesh.material.opacity = isSelected ? 0.45 : 0.28;
    for (const line of mesh.children) ((line as LineSegments).material as LineBasicMaterial).color.set(colour);
  }

  #add(original: CutDocument): Mesh<BufferGeometry, MeshBasicMaterial> | undefined {
    const shape = shapeOf(original);
    if (!shape) return undefined;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute(shape.positions, 3));
    geometry.setIndex(shape.triangles);
    const material = new MeshBasicMaterial({ transparent: true, depthWrite: false, side: DoubleSide });
    const mesh = new Mesh(geometry, material);
    // After the skin: drawn before it, a plane would be hidden by the translucent skin in front.
    mesh.renderOrder = 5;
    const edges = new BufferGeometry();
    edges.setAttribute("position", geometry.getAttribute("position"));
    edges.setIndex(shape.outline);
    // Its whole outline is seen, through bone, too.
    const line = new LineSegments(edges, new LineBasicMaterial({ depthTest: false, transparent: true, opacity: 0.7 }));
    line.renderOrder = 5;
    mesh.add(line);
    this.#stage.common.add(mesh);
    this.#meshes.set(original, mesh);
    return mesh;
  }
}
