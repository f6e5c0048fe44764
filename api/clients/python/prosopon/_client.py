"""The client: all operations of the document, and what a front-end needs beyond single requests."""

from __future__ import annotations

import os
from array import array
from typing import Any, Callable, Iterator, List, Literal, Optional, Union

from . import types as t
from ._follow import JobEvent, follow, has_ended
from ._frame import Frame, decode_frame, decode_topology
from ._operations import Operations
from ._problem import JobFailed
from ._transport import Progress, Source, given

SurfacePart = Literal["skin", "skull", "target", "tissue"]
#: A job: its id or its view.
JobRef = Union[str, t.JobView]


class Client(Operations):
    """A client of one service; threads may share it.

    `url` is `http://HOST:PORT` or `https://HOST:PORT`, `timeout_s` the longest wait for data in seconds, and `token` an API key, a
    token of an identity provider, or a function that returns one for each request.

    Coordinates are patient LPS in mm. An error answer raises `Problem`; without an answer a call raises `Unreachable`, reads and
    creations after about 8 s. Creations carry an idempotency key, so a repeated one is carried out once.
    """

    # ---- sessions and inputs ----

    def sessions(self) -> Iterator[t.SessionView]:
        """Yields all sessions, the newest first."""
        path: Optional[str] = "/v1/sessions"
        while path:
            page: t.SessionList = self.request("GET", path)
            yield from page["sessions"]
            path = page.get("next")

    def session(self, session: str) -> t.SessionView:
        """Reads a session with the state of its parts and its jobs."""
        return self.get_session(session)

    def put_surface(self, session: str, part: SurfacePart, file: Source, on_progress: Optional[Progress] = None) -> Any:
        """Uploads a surface (STL, PLY, OBJ or VTP, mm, LPS) or, as `tissue`, a mesh; returns its description."""
        return self.upload(self.path("/v1/sessions/{session}/{part}", session=session, part=part), file, on_progress)

    def surface_ply(self, session: str, part: Literal["skin", "skull", "target"]) -> bytes:
        """Reads a stored surface as binary PLY, LPS mm."""
        return self.get_bytes(self.path("/v1/sessions/{session}/{part}", {"format": "ply"}, session=session, part=part))

    def landmarks(self, session: str, propose: bool = False) -> t.LandmarksDocument:
        """Reads the landmarks; `propose` adds proposals for those that the session lacks."""
        return self.get_landmarks(session, propose=propose or None)

    def field(self, session: str) -> t.FieldView:
        """Reads the state and the report of the distance fields."""
        return self.get_field(session)

    def mesh(self, session: str) -> t.MeshView:
        """Reads the state and the report of the tissue mesh."""
        return self.get_mesh(session)

    def osteotomies(self, session: str) -> List[t.OsteotomyView]:
        """Lists the osteotomies."""
        return self.list_osteotomies(session)["osteotomies"]

    def segment_ply(self, session: str, osteotomy: str, segment: int) -> bytes:
        """Reads a segment at rest as binary PLY, LPS mm."""
        return self.get_segment(session, osteotomy, segment, format="ply")

    def plans(self, session: str) -> List[t.PlanView]:
        """Lists the plans."""
        return self.list_plans(session)["plans"]

    # ---- jobs ----

    def create_job(self, session: str, plan: str, **options: Any) -> t.JobView:
        """The same as `solve`."""
        return self.solve(session, plan, **options)

    def job(self, job: str, wait_s: Optional[float] = None) -> t.JobView:
        """Reads a job; with `wait_s`, waits so many seconds for its end."""
        return self.get_job(job, wait_s=wait_s)

    def cancel(self, job: str) -> t.JobView:
        """Asks a job to stop."""
        return self.cancel_job(job)

    def follow(
        self, job: JobRef, after: int = 0, on_interruption: Optional[Callable[[float], None]] = None
    ) -> Iterator[JobEvent]:
        """Yields the events of a job until its end.

        When the connection breaks, it reconnects and continues after the last event, for as long as the service is away;
        `on_interruption` is called with the seconds until the next attempt. After `resync` events are missing: read the job. An
        `end` with `continued_by` is followed by the events of that job. `after` is the id of the last event that is known.
        """
        return follow(self, _id(job), after, on_interruption)

    follow_job = follow

    def finished(self, job: JobRef, after: int = 0, on_event: Optional[Callable[[JobEvent], None]] = None) -> t.JobView:
        """Follows a job, and the jobs that continue it, to the end; returns the view of the last one."""
        last = _id(job)
        for event in self.follow(last, after):
            if on_event:
                on_event(event)
            if event["event"] == "end":
                last = event["data"].get("continued_by") or last
        view = self.get_job(last)
        if not has_ended(view):
            raise RuntimeError("the job %s sent its end but has the status %s" % (last, view["status"]))
        return view

    def wait(self, job: JobRef, on_event: Optional[Callable[[JobEvent], None]] = None) -> t.JobView:
        """The same as `finished`, but raises `JobFailed` for a job that did not succeed."""
        view = self.finished(job, 0, on_event)
        if view["status"] != "succeeded":
            raise JobFailed(view)
        return view

    # ---- results ----

    def topology(self, job: str) -> array[int]:
        """Reads the triangles of a solve's skin: three vertex numbers each."""
        return decode_topology(self.get_topology(job))

    def frame(self, job: str, k: int, vertices: int) -> Frame:
        """Reads the skin of step `k`; step 0 is the skin at rest. `vertices` is the number of its vertices."""
        return decode_frame(self.get_step_frame(job, k), vertices)

    def download_skin(self, job: str, k: int, filename: Union[str, "os.PathLike[str]"], format: str = "glb") -> str:
        """Writes the skin of step `k` to a file: `glb`, `ply`, `stl` or `vtp`. Returns its media type."""
        return self.download(self.path("/v1/jobs/{job}/steps/{k}/skin", {"format": format}, job=job, k=k), filename)

    def error(self, job: str, k: int) -> t.ErrorView:
        """Reads the signed error map of step `k`."""
        return self.get_step_error(job, k)

    def report(self, job: str) -> t.ReportDocument:
        """Reads the report of a solve."""
        return self.get_report(job)

    def report_html(self, job: str) -> str:
        """Reads the report of a solve as a page."""
        return self.get_report(job, format="html")

    def report_url(self, job: str) -> str:
        """Address of a job's report page; a link to it works only without a token."""
        return self.url(self.path("/v1/jobs/{job}/report", {"format": "html"}, job=job))

    def compare(
        self,
        prediction: t.SurfaceRef,
        reference: t.SurfaceRef,
        *,
        exclude: Optional[List[t.RegionRequest]] = None,
        exclude_eyes: Optional[bool] = None,
        mask: Optional[List[t.RegionRequest]] = None,
        mask_vertices: Optional[List[bool]] = None,
        register: Optional[t.RegisterRequest] = None,
        values: Optional[bool] = None,
    ) -> t.CompareView:
        """Compares two surfaces and returns the error map; waits when the service computes it as a job."""
        body = given(prediction=prediction, reference=reference, exclude=exclude, exclude_eyes=exclude_eyes, mask=mask)
        body.update(given(mask_vertices=mask_vertices, register=register, values=values))
        found = self.create("/v1/compare", body)
        if "links" in found:
            found = self.get_comparison(self.wait(found)["id"], values=values)
        result: t.CompareView = found
        return result


def _id(job: JobRef) -> str:
    return job if isinstance(job, str) else job["id"]
