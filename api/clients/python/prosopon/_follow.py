"""Events of a job over NDJSON."""

from __future__ import annotations

import json
import time
from typing import Any, Callable, Iterator, Optional, Union

from ._problem import Problem, Unreachable
from ._transport import BROKEN, Transport
from .types import (
    EndEvent,
    JobEventLineEnd,
    JobEventLineProgress,
    JobEventLineResync,
    JobEventLineStatus,
    JobEventLineStep,
    JobEventLineWarning,
    JobView,
)

#: An event of a job with its number; heartbeats are left out.
JobEvent = Union[
    JobEventLineStatus, JobEventLineProgress, JobEventLineStep, JobEventLineWarning, JobEventLineResync, JobEventLineEnd
]

_KNOWN = ("status", "progress", "step", "warning", "resync", "end")
_ENDED = ("succeeded", "failed", "cancelled")
# The service sends a heartbeat every 15 s; after three missed ones the connection is given up.
_SILENCE_S = 45.0
_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 5.0


def has_ended(job: JobView) -> bool:
    """Whether a job has ended."""
    return job["status"] in _ENDED


def follow(
    transport: Transport,
    job: str,
    after: int = 0,
    on_interruption: Optional[Callable[[float], None]] = None,
) -> Iterator[JobEvent]:
    """Yields the events of a job and of the jobs that continue it; see `Client.follow`."""
    while True:
        further = None
        for event in _one_job(transport, job, after, on_interruption):
            yield event
            if event["event"] == "end":
                further = event["data"].get("continued_by")
        if not further:
            return
        job, after = further, 0


def _one_job(
    transport: Transport, job: str, last: int, on_interruption: Optional[Callable[[float], None]]
) -> Iterator[JobEvent]:
    wait_s = _FIRST_WAIT_S
    while True:
        try:
            for event in _connection(transport, job, last):
                last = max(last, event["id"])
                wait_s = _FIRST_WAIT_S
                yield event
                if event["event"] == "end":
                    return
        except Unreachable:
            pass
        except Problem as problem:
            if not problem.passing:
                raise
        if on_interruption:
            on_interruption(wait_s)
        time.sleep(wait_s)
        wait_s = min(2 * wait_s, _LONGEST_WAIT_S)


def _connection(transport: Transport, job: str, last: int) -> Iterator[JobEvent]:
    path = transport.path("/v1/jobs/{job}/events", job=job)
    headers = {"Accept": "application/x-ndjson", "Last-Event-ID": str(last)}
    connection, response = transport.open("GET", path, None, headers, _SILENCE_S)
    try:
        if response.status == 204:
            yield _end_of(transport, job, last)
            return
        while True:
            try:
                line = response.readline()
            except BROKEN as cause:
                raise Unreachable(transport.url(path), cause) from cause
            # A stream that breaks off may end within a line; that event comes again after the reconnection.
            if not line.endswith(b"\n"):
                return
            event: Any = json.loads(line) if line.strip() else {}
            if event.get("event") in _KNOWN:
                yield event
    finally:
        connection.close()


def _end_of(transport: Transport, job: str, last: int) -> JobEvent:
    """End of a job whose events were all sent."""
    view: JobView = transport.request("GET", transport.path("/v1/jobs/{job}", job=job))
    if not has_ended(view):
        raise Unreachable(transport.url("/v1/jobs/%s/events" % job), "the stream ended before the job")
    links = view["links"]
    data: EndEvent = {"status": view["status"], "links": {"self": links["self"], "report": links.get("report")}}
    data["continued_by"] = view.get("continued_by")
    data["superseded_by"] = view.get("superseded_by")
    data["problem"] = view.get("problem")
    return {"event": "end", "id": last, "data": data}
