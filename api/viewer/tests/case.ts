import { openAsBlob } from "node:fs";
import { join } from "node:path";
import { Client } from "@prosopon/client";
import type { Service } from "./service.ts";
import { PHANTOM } from "./page.ts";

/** A session of the phantom with skin, skull, landmarks and field. */
export interface Case {
  client: Client;
  session: string;
}

/** An osteotomy with an 8 mm mesh. */
export interface CutCase extends Case {
  osteotomy: string;
}

/** Makes the session over the API: the page's own way is tested elsewhere, and takes longer. */
export async function phantomCase(service: Service, label: string, token?: string): Promise<Case> {
  const client = new Client({ baseUrl: service.url, token: () => token });
  const { id: session } = await client.createSession({ label });
  for (const part of ["skin", "skull"] as const) {
    await client.putSurface(session, part, await openAsBlob(join(PHANTOM, `${part}.stl`)));
  }
  await client.putLandmarks(session, JSON.parse(await (await openAsBlob(join(PHANTOM, "landmarks.json"))).text()));
  await client.finished((await client.buildField(session)).id);
  return { client, session };
}

/** Cuts the maxilla and builds the mesh. */
export async function leFortCase(service: Service, label: string, token?: string): Promise<CutCase> {
  const { client, session } = await phantomCase(service, label, token);
  const { id: osteotomy } = await client.createOsteotomy(session, { templates: [{ name: "le_fort_1" }] });
  await client.finished((await client.buildMesh(session, { osteotomy, edge_mm: 8 })).id);
  return { client, session, osteotomy };
}

/** Plans a translation of the maxilla; returns the plan's id. */
export async function planOf({ client, session, osteotomy }: CutCase, translation_mm: number[]): Promise<string> {
  return (await client.createPlan(session, { osteotomy, paths: [{ segment: 1, waypoints: [{ t: 1, translation_mm }] }] })).id;
}
