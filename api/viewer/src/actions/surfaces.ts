import type { App } from "./app.ts";
import { BufferGeometry, Float32BufferAttribute } from "three";
import { PLYLoader } from "three/addons/loaders/PLYLoader.js";

const PARTS = ["skin", "skull", "target"] as const;

/** Loads the surfaces of the open session that are new or have changed. */
export async function loadSurfaces(app: App): Promise<void> {
  await Promise.all(PARTS.map((part) => loadSurface(app, part)));
}

async function loadSurface(app: App, part: (typeof PARTS)[number]): Promise<void> {
  const { signal } = app;
  const session = app.state.session;
  const stored = session?.parts[part];
  if (!session || stored?.state !== "ready") return;
  const key = `${session.id} ${stored.sha256 ?? stored.updated_at ?? ""}`;
  if (app.state.surfaces[part]?.key === key) return;
  await app.load(`Load the ${part}`, async () => {
    const geometry = parsePly(await app.client.surfacePly(session.id, part, signal));
    signal.throwIfAborted();
    app.state.surfaces[part]?.geometry.dispose();
    app.set({ surfaces: { ...app.state.surfaces, [part]: { key, geometry } } });
  });
}

/** Geometry of a surface with vertex normals, LPS mm. */
export function parsePly(bytes: ArrayBuffer): BufferGeometry {
  const read = new PLYLoader().parse(bytes);
  const geometry = new BufferGeometry();
  // The service sends doubles, which the graphics card does not take.
  geometry.setAttribute("position", new Float32BufferAttribute(read.getAttribute("position").array, 3));
  geometry.setIndex(read.getIndex());
  geometry.computeVertexNormals();
  geometry.computeBoundingSphere();
  return geometry;
}
