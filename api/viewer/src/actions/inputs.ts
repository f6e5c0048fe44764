import type { App } from "./app.ts";
import type { FileRole, Schemas, Upload } from "../model/state.ts";
import { followAndLoad } from "./jobs.ts";
import { loadLandmarks } from "./landmarks.ts";
import { refreshSession } from "./session-view.ts";
import { createSession } from "./sessions.ts";
import { loadSurfaces } from "./surfaces.ts";

const SURFACE = /\.(stl|ply|obj|vtp)$/i;
const VOLUME = /\.(nii|nii\.gz|nrrd|mha|zip)$/i;
const BY_NAME: [RegExp, FileRole][] = [
  [/target|post|after/i, "target"],
  [/skull|bone|hard/i, "skull"],
  [/skin|face|soft/i, "skin"],
];

/** What a file is by its name; `undefined` when the name does not tell. */
export function roleOf(name: string): FileRole | undefined {
  if (/\.json$/i.test(name)) return "landmarks";
  if (VOLUME.test(name)) return "ct";
  return SURFACE.test(name) ? BY_NAME.find(([words]) => words.test(name))?.[1] : undefined;
}

/** Takes dropped files and uploads those whose role their name tells. Without an open session it creates one. */
export async function addFiles(app: App, files: readonly File[]): Promise<void> {
  if (files.length === 0) return;
  if (!app.state.session) await createSession(app, "");
  if (!app.state.session) return;
  const added = files.map((file): Upload => {
    return { id: app.nextId(), file, role: roleOf(file.name), state: "waiting", sent: 0 };
  });
  app.set({ uploads: [...app.state.uploads, ...added] });
  await sendWaiting(app);
}

/** Says what a file is, and uploads it. */
export async function setRole(app: App, id: number, role: FileRole): Promise<void> {
  patchUpload(app, id, { role, state: "waiting" });
  await sendWaiting(app);
}

export function removeUpload(app: App, id: number): void {
  app.set({ uploads: app.state.uploads.filter((upload) => upload.id !== id) });
}

/** Starts the job that builds the distance fields. */
export async function buildField(app: App): Promise<void> {
  const { session } = app.state;
  if (!session) return;
  const job = await app.attempt("Build the distance field", () => app.client.buildField(session.id));
  if (job) await followAndLoad(app, job);
}

/** Order of uploads. A CT goes first, because it replaces skin and skull. */
const ORDER: FileRole[] = ["ct", "skin", "skull", "target", "landmarks"];

async function sendWaiting(app: App): Promise<void> {
  const waiting = app.state.uploads.filter((upload) => upload.state === "waiting" && upload.role !== undefined);
  waiting.sort((a, b) => ORDER.indexOf(a.role as FileRole) - ORDER.indexOf(b.role as FileRole));
  for (const upload of waiting) patchUpload(app, upload.id, { state: "sending", sent: 0 });
  for (const upload of waiting) await send(app, upload);
  await app.attempt("Load the inputs", async () => {
    await refreshSession(app);
    await Promise.all([loadSurfaces(app), loadLandmarks(app)]);
  });
}

async function send(app: App, upload: Upload): Promise<void> {
  const { session } = app.state;
  if (!session || !upload.role) return;
  const done = await app.attempt(`Upload ${upload.file.name}`, async () => {
    if (upload.role === "landmarks") await sendLandmarks(app, session.id, upload.file);
    else await sendBytes(app, session.id, upload);
    return true;
  });
  patchUpload(app, upload.id, { state: done ? "done" : "failed", sent: upload.file.size });
}

async function sendBytes(app: App, session: string, upload: Upload): Promise<void> {
  const { signal } = app;
  const onProgress = (sent: number, total: number) => {
    patchUpload(app, upload.id, { sent, state: sent < total ? "sending" : "reading" });
  };
  const options = { signal, onProgress };
  if (upload.role === "ct") {
    const job = await app.client.putCt(session, upload.file, options);
    void followAndLoad(app, job);
  } else {
    await app.client.putSurface(session, upload.role as "skin" | "skull" | "target", upload.file, options);
  }
}

async function sendLandmarks(app: App, session: string, file: File): Promise<void> {
  const document: unknown = JSON.parse(await file.text());
  await app.client.putLandmarks(session, document as Schemas["LandmarksDocument"]);
  if (app.state.landmarks) app.set({ landmarks: { ...app.state.landmarks, changed: false } });
}

function patchUpload(app: App, id: number, patch: Partial<Upload>): void {
  app.set({ uploads: app.state.uploads.map((upload) => (upload.id === id ? { ...upload, ...patch } : upload)) });
}

/**
 * Files of a drop.
 *
 * @throws Error for a folder, which the service takes only as one archive
 */
export async function filesOf(transfer: DataTransfer): Promise<File[]> {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  if (entries.some((entry) => entry.isDirectory)) {
    throw new Error("Folders cannot be uploaded. Put the DICOM images of the series into a zip file and drop that.");
  }
  return [...transfer.files];
}
