import type { components } from "./openapi.ts";
import { hasEnded } from "./events.ts";
import type { JobEvent, JobView } from "./events.ts";
import { followJob } from "./follow.ts";
import type { FollowOptions } from "./follow.ts";
import { decodeFrame, decodeTopology } from "./frame.ts";
import type { Frame } from "./frame.ts";
import { expandPath } from "./paths.ts";
import type { QueryOf, Operation } from "./paths.ts";
import { Transport } from "./transport.ts";
import type { ClientOptions } from "./transport.ts";
import { upload } from "./upload.ts";
import type { UploadOptions } from "./upload.ts";

type Schemas = components["schemas"];

/** A surface that is uploaded whole. */
export type SurfacePart = "skin" | "skull" | "target";

/** Query parameters of a CT's upload. */
export type CtOptions = QueryOf<Operation<"put", "/v1/sessions/{session}/ct">>;

/** Which proposals `landmarks` adds. */
export interface LandmarkOptions {
  /** Adds proposals for landmarks that the session lacks; needs skin and skull. */
  propose?: boolean;
}

/**
 * A client of one service.
 *
 * Coordinates are patient LPS in mm. Every error answer rejects with `Problem`; without an answer a call rejects with `Unreachable`.
 */
export class Client {
  /** Sends any request of the API, with types from its OpenAPI document. */
  readonly transport: Transport;

  constructor(options: ClientOptions = {}) {
    this.transport = new Transport(options);
  }

  /** Lists sessions, the newest first; `before` is the `next` of the page before. */
  sessions(query: { before?: string; limit?: number } = {}): Promise<Schemas["SessionList"]> {
    return this.transport.call("get", "/v1/sessions", { query });
  }

  /** Creates a session. */
  createSession(body: Schemas["CreateSession"] = {}): Promise<Schemas["SessionView"]> {
    return this.transport.call("post", "/v1/sessions", { body });
  }

  /** Reads a session with the state of its parts and its jobs. */
  session(session: string): Promise<Schemas["SessionView"]> {
    return this.transport.call("get", "/v1/sessions/{session}", { path: { session } });
  }

  /** Deletes a session; it can be restored for a day. */
  deleteSession(session: string): Promise<undefined> {
    return this.transport.call("delete", "/v1/sessions/{session}", { path: { session } });
  }

  /** Uploads a surface: STL, PLY, OBJ or VTP, mm, LPS. */
  putSurface(session: string, part: SurfacePart, file: Blob, options?: UploadOptions): Promise<Schemas["SurfaceDocument"]> {
    return upload(this.transport, expandPath(`/v1/sessions/{session}/${part}`, { session }), file, options);
  }

  /** Uploads a CT: NIfTI, NRRD, MetaImage, or a zip of DICOM images. The answer is the job that makes skin and skull of it. */
  putCt(session: string, file: Blob, options: UploadOptions & { query?: CtOptions } = {}): Promise<JobView> {
    return upload(this.transport, expandPath("/v1/sessions/{session}/ct", { session }, options.query), file, options);
  }

  /** Reads a stored surface as binary PLY, LPS mm. */
  async surfacePly(session: string, part: SurfacePart, signal?: AbortSignal): Promise<ArrayBuffer> {
    const input = { path: { session }, query: { format: "ply" as const }, signal };
    return (await this.transport.read(`/v1/sessions/{session}/${part}`, input)).arrayBuffer();
  }

  /** Reads the landmarks. */
  landmarks(session: string, options: LandmarkOptions = {}): Promise<Schemas["LandmarksDocument"]> {
    const query = options.propose ? { propose: true } : {};
    return this.transport.call("get", "/v1/sessions/{session}/landmarks", { path: { session }, query });
  }

  /** Replaces all landmarks. */
  putLandmarks(session: string, body: Schemas["LandmarksDocument"]): Promise<Schemas["LandmarksDocument"]> {
    return this.transport.call("put", "/v1/sessions/{session}/landmarks", { path: { session }, body });
  }

  /** Starts the job that builds the distance fields. */
  buildField(session: string): Promise<JobView> {
    return this.transport.call("post", "/v1/sessions/{session}/field", { path: { session }, body: {} });
  }

  /** Lists the osteotomies. */
  async osteotomies(session: string): Promise<Schemas["OsteotomyView"][]> {
    return (await this.transport.call("get", "/v1/sessions/{session}/osteotomies", { path: { session } })).osteotomies;
  }

  /** Cuts the bone by templates, planes, polylines or surfaces. */
  createOsteotomy(session: string, body: Schemas["CreateOsteotomy"]): Promise<Schemas["OsteotomyView"]> {
    return this.transport.call("post", "/v1/sessions/{session}/osteotomies", { path: { session }, body });
  }

  /** Deletes an osteotomy. */
  deleteOsteotomy(session: string, osteotomy: string): Promise<undefined> {
    const path = { session, osteotomy };
    return this.transport.call("delete", "/v1/sessions/{session}/osteotomies/{osteotomy}", { path });
  }

  /** Reads a segment at rest as binary PLY, LPS mm. */
  async segmentPly(session: string, osteotomy: string, segment: number, signal?: AbortSignal): Promise<ArrayBuffer> {
    const path = { session, osteotomy, segment };
    const input = { path, query: { format: "ply" as const }, signal };
    const answer = await this.transport.read("/v1/sessions/{session}/osteotomies/{osteotomy}/segments/{segment}", input);
    return answer.arrayBuffer();
  }

  /** Lists the plans. */
  async plans(session: string): Promise<Schemas["PlanView"][]> {
    return (await this.transport.call("get", "/v1/sessions/{session}/plans", { path: { session } })).plans;
  }

  /** Reads a plan; the first reading measures overlaps and gaps of bone, which takes a second. */
  plan(session: string, plan: string): Promise<Schemas["PlanView"]> {
    return this.transport.call("get", "/v1/sessions/{session}/plans/{plan}", { path: { session, plan } });
  }

  /** Creates a plan: the paths of the moving segments. */
  createPlan(session: string, body: Schemas["CreatePlan"]): Promise<Schemas["PlanView"]> {
    return this.transport.call("post", "/v1/sessions/{session}/plans", { path: { session }, body });
  }

  /** Starts the job that builds the tissue mesh. */
  buildMesh(session: string, body: Schemas["MeshRequest"] = {}): Promise<JobView> {
    return this.transport.call("post", "/v1/sessions/{session}/mesh", { path: { session }, body });
  }

  /** Reads the state and the report of the tissue mesh. */
  mesh(session: string): Promise<Schemas["MeshView"]> {
    return this.transport.call("get", "/v1/sessions/{session}/mesh", { path: { session } });
  }

  /** Starts a solve. */
  solve(session: string, body: Schemas["SolveRequest"]): Promise<JobView> {
    return this.transport.call("post", "/v1/sessions/{session}/jobs", { path: { session }, body });
  }

  /** Reads a job. */
  job(job: string): Promise<JobView> {
    return this.transport.call("get", "/v1/jobs/{job}", { path: { job } });
  }

  /** Asks a job to stop. */
  cancel(job: string): Promise<JobView> {
    return this.transport.call("post", "/v1/jobs/{job}/cancel", { path: { job } });
  }

  /** Yields a job's events until its end; see `followJob`. */
  follow(job: string, options?: FollowOptions): AsyncGenerator<JobEvent> {
    return followJob(this.transport, job, options);
  }

  /** Follows a job to its end and reads it. It does not follow the job that `continued_by` names. */
  async finished(job: string, options?: FollowOptions & { onEvent?: (event: JobEvent) => void }): Promise<JobView> {
    for await (const event of this.follow(job, options)) options?.onEvent?.(event);
    const view = await this.job(job);
    if (!hasEnded(view.status)) throw new Error(`the job ${job} sent its end but has the status ${view.status}`);
    return view;
  }

  /** Reads the triangles of a solve's skin. */
  async topology(job: string, signal?: AbortSignal): Promise<Uint32Array<ArrayBuffer>> {
    const answer = await this.transport.read("/v1/jobs/{job}/topology", { path: { job }, signal });
    return decodeTopology(await answer.arrayBuffer());
  }

  /** Reads the skin of step `k`; step 0 is the skin at rest. `vertices` is the number of its vertices. */
  async frame(job: string, k: number, vertices: number, signal?: AbortSignal): Promise<Frame> {
    const answer = await this.transport.read("/v1/jobs/{job}/steps/{k}/frame", { path: { job, k }, signal });
    return decodeFrame(await answer.arrayBuffer(), vertices);
  }

  /** Reads the report of a solve. */
  report(job: string, signal?: AbortSignal): Promise<Schemas["ReportDocument"]> {
    return this.transport.call("get", "/v1/jobs/{job}/report", { path: { job }, query: { format: "json" }, signal });
  }

  /** Reads the report of a solve as a page. */
  async reportHtml(job: string): Promise<string> {
    return (await this.transport.read("/v1/jobs/{job}/report", { path: { job }, query: { format: "html" } })).text();
  }

  /** Address of a job's report page; a link to it works only without a token. */
  reportUrl(job: string): string {
    return this.transport.url(expandPath("/v1/jobs/{job}/report", { job }, { format: "html" }));
  }
}
