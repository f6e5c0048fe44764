import { BufferGeometry, Color, DoubleSide, Matrix4, Mesh, MeshLambertMaterial } from "three";
import { SEGMENT_COLOURS } from "../colour/segment-colours.ts";
import { draftAt, plannedAt } from "../model/motion.ts";
import type { Point } from "../model/motion.ts";
import { matrixOf } from "../model/screw.ts";
import type { Cut, Surface } from "../model/state.ts";
import { setOpacity } from "./opacity.ts";
import type { Stage } from "./stage.ts";

/** What the bones show. */
export interface BonesView {
  skull: Surface | undefined;
  cut: Cut | undefined;
  t: number;
  opacity: number;
  condyles: [Point, Point] | undefined;
}

/** The skull in one piece, or the segments of an osteotomy at a place of their paths. */
export class Bones {
  readonly #stage: Stage;
  readonly #skull = new Mesh(new BufferGeometry(), material(0));
  #segments = new Map<number, Mesh<BufferGeometry, MeshLambertMaterial>>();
  #surfaces: Cut["surfaces"] | undefined;

  constructor(stage: Stage) {
    this.#stage = stage;
    stage.common.add(this.#skull);
  }

  /** Moving segments, for choosing one by a click. */
  get moving(): [number, Mesh][] {
    return [...this.#segments].filter(([id]) => id !== 0);
  }

  /** All meshes, hidden ones included. */
  get meshes(): Mesh[] {
    return [this.#skull, ...this.#segments.values()];
  }

  show(view: BonesView): void {
    if (view.skull) this.#skull.geometry = view.skull.geometry;
    this.#skull.visible = view.skull !== undefined && view.cut === undefined && view.opacity > 0;
    if (view.cut?.surfaces !== this.#surfaces) this.#build(view.cut);
    for (const [id, mesh] of this.#segments) {
      mesh.visible = view.opacity > 0;
      mesh.matrix.copy(view.cut ? matrixAt(view.cut, id, view.t, view.condyles) : new Matrix4());
      mesh.material.emissive.set(view.cut?.selected === id && view.cut.surfaces.size > 2 ? 0x1c1c1c : 0);
    }
    for (const mesh of [this.#skull, ...this.#segments.values()]) setOpacity(mesh.material, view.opacity);
  }

  #build(cut: Cut | undefined): void {
    for (const mesh of this.#segments.values()) mesh.removeFromParent();
    this.#surfaces = cut?.surfaces;
    this.#segments = new Map([...(cut?.surfaces ?? [])].map(([id, geometry]) => {
      const mesh = new Mesh(geometry, material(id));
      mesh.matrixAutoUpdate = false;
      this.#stage.common.add(mesh);
      return [id, mesh];
    }));
  }
}

/** Place of a segment: on its planned path, or on the path of the draft before the service has planned it. */
function matrixAt(cut: Cut, id: number, t: number, condyles: [Point, Point] | undefined): Matrix4 {
  const path = cut.plan?.paths.find(({ segment }) => segment === id);
  if (path) return matrixOf(plannedAt(path, t));
  const motion = cut.motions.get(id);
  return motion && !cut.plan ? matrixOf(draftAt(motion, t, condyles)) : new Matrix4();
}

function material(id: number): MeshLambertMaterial {
  const color = new Color(SEGMENT_COLOURS[id % SEGMENT_COLOURS.length]);
  return new MeshLambertMaterial({ color, side: DoubleSide });
}
