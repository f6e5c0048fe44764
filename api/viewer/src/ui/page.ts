import { html, nothing, render } from "lit-html";
import type { TemplateResult } from "lit-html";
import type { App } from "../actions/app.ts";
import { addFiles, filesOf } from "../actions/inputs.ts";
import { togglePlay } from "../actions/play.ts";
import type { Hover } from "../scene/pointer.ts";
import { FaceScene } from "../scene/scene.ts";
import { standardView, VIEW_NAMES } from "../scene/views.ts";
import { captions } from "./captions.ts";
import { controls, viewButtons } from "./controls.ts";
import { cutsPanel } from "./cuts.ts";
import { header } from "./header.ts";
import { inputsPanel } from "./inputs.ts";
import { landmarksPanel } from "./landmarks.ts";
import { legend } from "./legend.ts";
import { movementPanel } from "./movement.ts";
import { jobsPanel, predictionPanel } from "./prediction.ts";
import { problemList } from "./problems.ts";
import { profilePanel } from "./profile.ts";
import { sessionsPanel } from "./sessions.ts";

/** Turn of the camera for each press of an arrow key, degrees. */
const KEY_TURN_DEG = 7.5;

/** The page: panels beside the picture, controls below it. Files may be dropped anywhere. */
export class Page {
  readonly #app: App;
  readonly #root: HTMLElement;
  readonly #canvas = document.createElement("canvas");
  readonly #tip = document.createElement("output");
  readonly #sides = [document.createElement("span"), document.createElement("span")];
  readonly #scene: FaceScene;

  constructor(app: App, root: HTMLElement) {
    this.#app = app;
    this.#root = root;
    this.#canvas.tabIndex = 0;
    this.#canvas.setAttribute("role", "img");
    this.#tip.className = "tip";
    this.#tip.hidden = true;
    for (const side of this.#sides) side.className = "side";
    render(this.#content(), root);
    this.#scene = new FaceScene(app, this.#canvas, {
      onHover: (hover) => this.#showTip(hover),
      onSides: (...sides) => this.#showSides(sides),
    });
    app.store.subscribe(() => render(this.#content(), root));
    this.#canvas.addEventListener("keydown", (event) => this.#key(event));
    this.#takeDrops();
  }

  #content(): TemplateResult {
    const app = this.#app;
    const subject = app.state.comparison ? "Faces of two predictions." : "Face and skull.";
    this.#canvas.setAttribute("aria-label", `${subject} Arrow keys turn the view, + and − change its distance, 1 to 4 choose a view.`);
    return html`
      ${header(app)}
      ${problemList(app)}
      <main class="stage ${app.state.comparison ? "split" : ""}">
        <div class="picture">
          ${this.#canvas} ${captions(app)} ${this.#sides}
          ${viewButtons((view) => this.#scene.setView(view))}
          ${this.#tip} ${this.#hint()}
        </div>
        ${legend(app)}
        ${controls(app)}
      </main>
      <aside class="panels" aria-label="Case">
        ${sessionsPanel(app)} ${inputsPanel(app)} ${landmarksPanel(app)} ${cutsPanel(app)} ${movementPanel(app)}
        ${predictionPanel(app)} ${profilePanel(app)} ${jobsPanel(app)}
      </aside>
    `;
  }

  /** What to do while the picture is empty. */
  #hint(): TemplateResult | typeof nothing {
    const { session, surfaces, busy } = this.#app.state;
    if (surfaces.skin || surfaces.skull || busy.length > 0) return nothing;
    const text = session ? "Drop a CT, or surfaces of skin and skull, onto the page." : "Open a session, or drop a CT or surfaces onto the page.";
    return html`<p class="hint">${text}</p>`;
  }

  #showTip(hover: Hover | undefined): void {
    this.#tip.hidden = hover === undefined;
    if (!hover) return;
    this.#tip.textContent = hover.text;
    this.#tip.style.left = `${hover.x}px`;
    this.#tip.style.top = `${hover.y}px`;
  }

  #showSides(letters: [string, string]): void {
    const names: Record<string, string> = { R: "patient's right", L: "patient's left", A: "front", P: "back" };
    for (const [i, side] of this.#sides.entries()) {
      side.textContent = letters[i] ?? "";
      side.title = names[letters[i] ?? ""] ?? "";
    }
  }

  #key(event: KeyboardEvent): void {
    const view = VIEW_NAMES.find((name) => standardView(name).key === event.key);
    const turns: Record<string, [number, number, number]> = {
      ArrowLeft: [-KEY_TURN_DEG, 0, 1],
      ArrowRight: [KEY_TURN_DEG, 0, 1],
      ArrowUp: [0, KEY_TURN_DEG, 1],
      ArrowDown: [0, -KEY_TURN_DEG, 1],
      "+": [0, 0, 0.9],
      "-": [0, 0, 1 / 0.9],
    };
    const turn = turns[event.key];
    if (view) this.#scene.setView(view);
    else if (turn) this.#scene.orbit(...turn);
    else if (event.key === " ") togglePlay(this.#app);
    else return;
    event.preventDefault();
  }

  #takeDrops(): void {
    const root = this.#root;
    addEventListener("dragover", (event) => {
      event.preventDefault();
      root.classList.add("dropping");
    });
    addEventListener("dragleave", (event) => {
      if (event.relatedTarget === null) root.classList.remove("dropping");
    });
    addEventListener("drop", (event) => {
      event.preventDefault();
      root.classList.remove("dropping");
      const { dataTransfer } = event;
      if (dataTransfer) void this.#app.attempt("Take the files", async () => addFiles(this.#app, await filesOf(dataTransfer)));
    });
  }
}
