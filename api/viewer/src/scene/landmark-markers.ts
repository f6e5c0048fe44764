import { Mesh, MeshBasicMaterial, OctahedronGeometry, Plane, SphereGeometry, Vector3 } from "three";
import type { Object3D, Raycaster } from "three";
import type { Point } from "../model/motion.ts";
import type { Landmarks } from "../model/state.ts";
import type { Stage } from "./stage.ts";

const SPHERE = new SphereGeometry(1.5, 16, 12);
const OCTAHEDRON = new OctahedronGeometry(2.1);
const CONFIRMED = new MeshBasicMaterial({ color: "#1668c7", depthTest: false, transparent: true, opacity: 0.9 });
const PROPOSED = new MeshBasicMaterial({ color: "#e07b00", depthTest: false, transparent: true, opacity: 0.9 });
const HALO = new MeshBasicMaterial({ color: "#ffffff", depthTest: false, transparent: true, opacity: 0.9 });
const HALO_SCALE = 1.3;
const SELECTED_SCALE = 1.7;

/** A dragged landmark is put onto a surface that lies nearer to the cursor's plane than this, mm. */
const SNAP_MM = 6;

/** Landmarks in the scene: spheres when confirmed, octahedra of another colour when proposed. */
export class LandmarkMarkers {
  readonly #stage: Stage;
  readonly #markers = new Map<string, Mesh>();

  constructor(stage: Stage) {
    this.#stage = stage;
  }

  show(landmarks: Landmarks | undefined, visible: boolean): void {
    const points = visible ? (landmarks?.document.points ?? {}) : {};
    for (const [name, marker] of this.#markers) {
      if (name in points) continue;
      marker.removeFromParent();
      this.#markers.delete(name);
    }
    for (const [name, point] of Object.entries(points)) {
      const marker = this.#markers.get(name) ?? this.#add(name);
      const proposed = landmarks?.document.proposed?.includes(name) === true;
      marker.geometry = proposed ? OCTAHEDRON : SPHERE;
      for (const halo of marker.children) (halo as Mesh).geometry = marker.geometry;
      marker.material = proposed ? PROPOSED : CONFIRMED;
      marker.position.fromArray(point);
      marker.scale.setScalar(landmarks?.selected === name ? SELECTED_SCALE : 1);
    }
  }

  /** Name of the landmark under the cursor. */
  pick(raycaster: Raycaster): string | undefined {
    const hit = raycaster.intersectObjects([...this.#markers.values()], false)[0];
    return hit?.object.name;
  }

  /**
   * Place of a landmark that the cursor drags: on the plane through the landmark that faces the camera, and from there onto a
   * surface close by.
   */
  dragged(raycaster: Raycaster, from: Point, surfaces: Object3D[]): Point | undefined {
    const normal = this.#stage.camera.getWorldDirection(new Vector3());
    const plane = new Plane().setFromNormalAndCoplanarPoint(normal, new Vector3(...from));
    const free = raycaster.ray.intersectPlane(plane, new Vector3());
    if (!free) return undefined;
    const hits = raycaster.intersectObjects(surfaces, false).map(({ point }) => point);
    const nearest = hits.sort((a, b) => a.distanceTo(free) - b.distanceTo(free))[0];
    const place = nearest && nearest.distanceTo(free) < SNAP_MM ? nearest : free;
    return place.toArray();
  }

  #add(name: string): Mesh {
    const marker = new Mesh(SPHERE, CONFIRMED);
    marker.name = name;
    marker.renderOrder = 10;
    // White behind the marker: it is seen on skin, bone and colour maps alike.
    const halo = new Mesh(SPHERE, HALO);
    halo.renderOrder = 9;
    halo.scale.setScalar(HALO_SCALE);
    marker.add(halo);
    this.#stage.common.add(marker);
    this.#markers.set(name, marker);
    return marker;
  }
}
