import {
  HalfFloatType, Mesh, MeshBasicMaterial, OrthographicCamera, PlaneGeometry, Scene, Vector4, WebGLRenderTarget,
} from "three";
import type { Camera, Object3D, WebGLRenderer } from "three";

/**
 * Draws the scene, or a blend of two pictures of it.
 *
 * Two transparent surfaces at nearly the same place cannot be sorted, so the blend mixes whole pictures: one with the face before,
 * one with the face after.
 */
export class Crossfade {
  readonly #renderer: WebGLRenderer;
  readonly #target = new WebGLRenderTarget(1, 1, { samples: 4, type: HalfFloatType });
  readonly #material: MeshBasicMaterial;
  readonly #sheet = new Scene();
  readonly #camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  constructor(renderer: WebGLRenderer) {
    this.#renderer = renderer;
    this.#material = new MeshBasicMaterial({ map: this.#target.texture, transparent: true, depthTest: false, premultipliedAlpha: true });
    this.#sheet.add(new Mesh(new PlaneGeometry(2, 2), this.#material));
  }

  /** Draws into the renderer's viewport. `blend` is the share of the picture with `after`: 0 shows `before` alone, 1 `after` alone. */
  render(scene: Scene, camera: Camera, before: Object3D, after: Object3D, blend: number): void {
    const renderer = this.#renderer;
    const mixed = before.children.length > 0 && blend > 0 && blend < 1;
    before.visible = before.children.length > 0 && blend < 1;
    after.visible = !before.visible;
    renderer.setRenderTarget(null);
    renderer.render(scene, camera);
    if (!mixed) return;
    before.visible = false;
    after.visible = true;
    const { z: width, w: height } = renderer.getCurrentViewport(new Vector4());
    this.#target.setSize(width, height);
    renderer.setRenderTarget(this.#target);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    this.#material.opacity = blend;
    renderer.autoClear = false;
    renderer.render(this.#sheet, this.#camera);
    renderer.autoClear = true;
  }
}
