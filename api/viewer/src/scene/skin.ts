import { BufferAttribute, BufferGeometry, Color, DoubleSide, Mesh, MeshLambertMaterial } from "three";
import type { Group } from "three";
import { colourValues } from "../colour/colour-map.ts";
import type { MapName, Scale } from "../colour/colour-map.ts";
import type { Surface } from "../model/state.ts";
import { mixed } from "../model/prediction.ts";
import type { Prediction } from "../model/prediction.ts";
import { setOpacity } from "./opacity.ts";

const SKIN = new Color("#d8ab91");
const WHITE = new Color("#ffffff");

/** What the skin shows. */
export interface SkinView {
  surface: Surface | undefined;
  prediction: Prediction | undefined;
  t: number;
  opacity: number;
  map: SkinMap | undefined;
}

/** Values at the vertices, mm, and how they are coloured. */
export interface SkinMap {
  values: Float32Array;
  name: MapName;
  scale: Scale;
}

/** The skin: that of the session, or that of a prediction at a place of its path, with the face before it. */
export class Skin {
  readonly #beforeGroup: Group | undefined;
  readonly #after = new Mesh(new BufferGeometry(), material());
  readonly #before = new Mesh(new BufferGeometry(), material());
  #prediction: Prediction | undefined;
  /** Values that the colours show, at the vertices of the shown mesh. */
  #values: Float32Array | undefined;

  /** `after` gets the shown skin; `before`, where it is given, the skin at rest. */
  constructor(after: Group, before?: Group) {
    this.#beforeGroup = before;
    after.add(this.#after);
  }

  /** Mesh of the shown skin, for the value under the cursor. */
  get mesh(): Mesh {
    return this.#after;
  }

  get isColoured(): boolean {
    return this.#values !== undefined;
  }

  /** Value of the colour map at a point of a triangle with barycentric weights; `undefined` where there is none. */
  valueAt(corners: readonly number[], weights: readonly number[]): number | undefined {
    const values = this.#values;
    if (!values) return undefined;
    const value = corners.reduce((sum, corner, i) => sum + (weights[i] ?? 0) * (values[corner] ?? Number.NaN), 0);
    return Number.isFinite(value) ? value : undefined;
  }

  show(view: SkinView): void {
    if (view.prediction !== this.#prediction) this.#build(view.prediction);
    if (view.prediction) this.#place(view.prediction, view.t);
    else if (view.surface) this.#after.geometry = view.surface.geometry;
    this.#after.visible = (view.prediction ?? view.surface) !== undefined && view.opacity > 0;
    this.#colour(view.map);
    for (const mesh of [this.#after, this.#before]) setOpacity(mesh.material, view.opacity);
    this.#before.visible = view.opacity > 0;
  }

  #build(prediction: Prediction | undefined): void {
    if (this.#prediction) this.#after.geometry.dispose();
    this.#prediction = prediction;
    this.#before.removeFromParent();
    if (!prediction) {
      this.#after.geometry = new BufferGeometry();
      return;
    }
    const index = new BufferAttribute(prediction.triangles, 1);
    const { frame, normals } = prediction.rest;
    this.#before.geometry.dispose();
    this.#before.geometry = geometryOf(frame.positions, normals, index);
    this.#after.geometry = geometryOf(frame.positions.slice(), normals.slice(), index);
    this.#after.geometry.setAttribute("color", new BufferAttribute(new Float32Array(frame.positions.length), 3));
    this.#beforeGroup?.add(this.#before);
  }

  #place(prediction: Prediction, t: number): void {
    const { a, b, weight } = prediction.at(t);
    const { position, normal } = this.#after.geometry.attributes;
    mixed(a.frame.positions, b.frame.positions, weight, position?.array as Float32Array);
    // Not of unit length between steps; the shader normalises them.
    mixed(a.normals, b.normals, weight, normal?.array as Float32Array);
    if (position) position.needsUpdate = true;
    if (normal) normal.needsUpdate = true;
  }

  #colour(map: SkinMap | undefined): void {
    this.#values = map?.values;
    const own = this.#after.material;
    if (own.vertexColors !== (map !== undefined)) {
      own.vertexColors = map !== undefined;
      own.needsUpdate = true;
    }
    own.color = map ? WHITE : SKIN;
    const attribute = this.#after.geometry.attributes["color"];
    if (!map || !attribute) return;
    colourValues(map.values, map.name, map.scale, attribute.array as Float32Array);
    attribute.needsUpdate = true;
  }
}

function material(): MeshLambertMaterial {
  // Both sides: narrow triangles that face away would be holes through which bone shines.
  return new MeshLambertMaterial({ color: SKIN, side: DoubleSide });
}

function geometryOf(positions: Float32Array<ArrayBuffer>, normals: Float32Array<ArrayBuffer>, index: BufferAttribute): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new BufferAttribute(normals, 3));
  geometry.setIndex(index);
  geometry.computeBoundingSphere();
  // The face moves less than this; the sphere is computed once.
  if (geometry.boundingSphere) geometry.boundingSphere.radius += 100;
  return geometry;
}
