import type { App } from "./app.ts";

/** Time of the whole path, ms. */
const PATH_MS = 2500;

/** Plays the path once, from the start when it stands at its end. Later steps join while they arrive. */
export function togglePlay(app: App): void {
  if (app.state.display.playing) return app.display({ playing: false });
  const { t } = app.state.display;
  app.display({ playing: true, t: t >= 1 ? 0 : t, blend: 1 });
  let before = performance.now();
  const advance = (now: number) => {
    const { display, prediction } = app.state;
    if (!display.playing) return;
    const t = Math.min(display.t + (now - before) / PATH_MS, reach(app));
    before = now;
    const running = prediction !== undefined && prediction.arrived < prediction.total;
    const playing = t < 1 && (running || t < reach(app));
    app.display({ t, playing });
    if (playing) requestAnimationFrame(advance);
  };
  requestAnimationFrame(advance);
}

/** Place up to which the path can be played. */
function reach(app: App): number {
  return app.state.prediction?.reach ?? 1;
}
