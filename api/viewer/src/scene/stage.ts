import { AmbientLight, DirectionalLight, Group, HemisphereLight, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Crossfade } from "./crossfade.ts";
import { inPane, paneAt, panesOf } from "./panes.ts";
import type { Pane } from "./panes.ts";
import { sidesOf, standardView } from "./views.ts";
import type { ViewName } from "./views.ts";

/** Narrow, so that faces look as in a portrait, degrees. */
const FIELD_OF_VIEW_DEG = 22;

/**
 * Canvas, camera and light. It draws only after a change.
 *
 * The scene has the coordinates of the API: LPS, mm, z up. A camera in front of the face therefore shows the patient's left on the
 * right of the picture.
 */
export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 10, 5000);
  readonly controls: OrbitControls;
  readonly canvas: HTMLCanvasElement;
  /** Shown in both pictures of a crossfade. */
  readonly common = new Group();
  readonly before = new Group();
  readonly after = new Group();
  /** Shown alone in the second view. */
  readonly second = new Group();
  readonly #renderer: WebGLRenderer;
  readonly #crossfade: Crossfade;
  readonly #light = new DirectionalLight(0xffffff, 1.9);
  #scheduled = false;
  /** Called with the sides of the patient at the left and right edge of the picture, when they change. */
  onSides: (left: string, right: string) => void = () => undefined;
  #sides = "";
  #blend = 1;
  #isSplit = false;
  #view: ViewName = "three-quarter";
  #centre = new Vector3(0, 0, 30);
  #radius = 130;

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
    this.#renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: false });
    this.#crossfade = new Crossfade(this.#renderer);
    this.camera.up.set(0, 0, 1);
    // A light beside the camera shades every view alike; colours of maps stay readable.
    this.camera.add(this.#light);
    this.#light.position.set(0.4, 0.6, 1);
    this.scene.add(this.camera, new AmbientLight(0xffffff, 0.7), new HemisphereLight(0xffffff, 0x8d8d99, 0.9));
    this.scene.add(this.common, this.before, this.after, this.second);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.#resize()).observe(canvas.parentElement ?? canvas);
    this.setView(this.#view);
    this.#resize();
  }

  /** Draws in the next animation frame. */
  draw(): void {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      for (const [i, pane] of this.#panes.entries()) this.#drawPane(pane, i === 1);
      this.#reportSides();
    });
  }

  /** Shows one view, or two with one camera. */
  setSplit(isSplit: boolean): void {
    if (this.#isSplit === isSplit) return;
    this.#isSplit = isSplit;
    this.#resize();
  }

  /** Normalised device coordinates of a point of the window, and the number of the view in which it lies, 0 or 1. */
  locate(clientX: number, clientY: number): { at: [number, number]; view: number } {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [clientX - box.left, clientY - box.top];
    const view = Math.max(paneAt(this.#panes, x, y), 0);
    return { at: inPane(this.#panes[view] as Pane, x, y), view };
  }

  /** Share of the predicted face in the picture; below 1 the face before shows through. */
  setBlend(blend: number): void {
    this.#blend = blend;
  }

  /** Centre and radius of what standard views show, mm. */
  setSubject(centre: Vector3, radius: number): void {
    if (this.#centre.distanceTo(centre) < 1 && Math.abs(this.#radius - radius) < 1) return;
    this.#centre = centre.clone();
    this.#radius = radius;
    this.setView(this.#view);
  }

  setView(view: ViewName): void {
    this.#view = view;
    const { direction } = standardView(view);
    const narrow = Math.min(this.camera.aspect, 1);
    const half = (FIELD_OF_VIEW_DEG * Math.PI) / 360;
    const distance = this.#radius / Math.sin(Math.atan(Math.tan(half) * narrow));
    this.camera.position.copy(direction).multiplyScalar(distance).add(this.#centre);
    this.controls.target.copy(this.#centre);
    this.controls.update();
    this.draw();
  }

  /** Turns the camera about the subject, degrees, and changes its distance by a factor. */
  orbit(leftDeg: number, upDeg: number, factor = 1): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const right = this.camera.up.clone().cross(offset).normalize();
    offset.applyAxisAngle(this.camera.up, (-leftDeg * Math.PI) / 180);
    const turned = offset.clone().applyAxisAngle(right, (-upDeg * Math.PI) / 180);
    // Not across the pole: there left and right would change places.
    if (Math.abs(turned.clone().normalize().z) < 0.98) offset.copy(turned);
    this.camera.position.copy(this.controls.target).addScaledVector(offset, factor);
    this.controls.update();
    this.draw();
  }

  get #panes(): Pane[] {
    const { clientWidth, clientHeight } = this.canvas.parentElement ?? this.canvas;
    return panesOf(clientWidth, clientHeight, this.#isSplit);
  }

  #drawPane({ x, y, width, height }: Pane, isSecond: boolean): void {
    const { clientHeight } = this.canvas.parentElement ?? this.canvas;
    const fromBelow = clientHeight - y - height;
    this.#renderer.setScissorTest(this.#isSplit);
    this.#renderer.setScissor(x, fromBelow, width, height);
    this.#renderer.setViewport(x, fromBelow, width, height);
    const [shown, other] = isSecond ? [this.second, this.after] : [this.after, this.second];
    other.visible = false;
    this.common.visible = !isSecond;
    this.#crossfade.render(this.scene, this.camera, this.before, shown, this.#blend);
  }

  #reportSides(): void {
    const [left, right] = sidesOf(this.camera);
    if (this.#sides === left + right) return;
    this.#sides = left + right;
    this.onSides(left, right);
  }

  #resize(): void {
    const { clientWidth, clientHeight } = this.canvas.parentElement ?? this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    const wasNarrow = this.camera.aspect;
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.#renderer.setSize(clientWidth, clientHeight);
    const { width, height } = this.#panes[0] as Pane;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (Math.min(wasNarrow, 1) !== Math.min(this.camera.aspect, 1)) this.#keepSize(wasNarrow);
    this.draw();
  }

  /** Keeps the subject in the picture when the canvas becomes narrower or wider. */
  #keepSize(aspect: number): void {
    const factor = Math.min(aspect, 1) / Math.min(this.camera.aspect, 1);
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }
}
