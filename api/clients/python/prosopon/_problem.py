"""Errors that the calls raise."""

from __future__ import annotations

import json
from typing import Any, Dict, List, Optional, cast

from .types import JobView, ProblemDocument, ProblemField


class Problem(Exception):
    """An error answer of the service, an RFC 9457 problem. `api/problems.md` explains each kind."""

    def __init__(self, document: ProblemDocument, retry_after_s: Optional[float] = None) -> None:
        #: Problem as the service sent it; some kinds have further members.
        self.document: Dict[str, Any] = dict(document)
        self.type: str = document["type"]
        #: Last part of `type`: the name of a section of `api/problems.md`.
        self.kind: str = self.type.rsplit("/", 1)[-1]
        self.title: str = document["title"]
        #: HTTP status.
        self.status: int = document["status"]
        #: What is wrong in this case, and what to do.
        self.detail: str = document.get("detail") or ""
        #: Values of the request that are not allowed.
        self.errors: List[ProblemField] = document.get("errors") or []
        #: Id of the request in the service's log.
        self.request_id: Optional[str] = document.get("request_id")
        #: Seconds after which the service may take the request.
        self.retry_after_s = retry_after_s
        lines = ["%d %s: %s" % (self.status, self.title, self.detail)]
        lines += ["  %s: %s" % (error["pointer"], error["detail"]) for error in self.errors]
        super().__init__("\n".join(lines))

    @classmethod
    def parse(cls, text: bytes, status: int, reason: str, retry_after: Optional[str]) -> Problem:
        """Reads the body of an error answer; a proxy's answer without a document gets its status line as title."""
        found: Any = None
        try:
            found = json.loads(text)
        except ValueError:
            pass
        if not (isinstance(found, dict) and {"type", "title", "status"} <= found.keys()):
            detail = text[:200].decode("utf-8", "replace")
            found = {"type": "about:blank", "title": reason or "HTTP status", "status": status, "detail": detail}
        try:
            seconds = None if retry_after is None else float(retry_after)
        except ValueError:
            # The header may also hold a date; the usual waits then apply.
            seconds = None
        return cls(cast(ProblemDocument, found), seconds)

    @property
    def passing(self) -> bool:
        """Whether the same request may succeed later: the service, or a proxy before it, refuses work for now."""
        return self.status in (502, 503, 504) or (self.status == 500 and self.kind == "about:blank")


class Unreachable(Exception):
    """No answer: there is no network, the service does not run, or the connection broke."""

    def __init__(self, url: str, cause: object) -> None:
        super().__init__("%s does not answer (%s). Check the network and that the service runs." % (url, cause))


class JobFailed(Exception):
    """A job that failed or was cancelled; `job` is its view, `job["problem"]` the cause."""

    def __init__(self, job: JobView) -> None:
        self.job = job
        problem = job.get("problem")
        super().__init__("job %s %s: %s" % (job["id"], job["status"], problem["detail"] if problem else ""))
