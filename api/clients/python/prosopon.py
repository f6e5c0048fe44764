"""Client of the Prosopon API; needs only the standard library.

    from prosopon import Client
    client = Client("http://127.0.0.1:8080")
    session = client.create_session(label="case 1")
    client.put_surface(session["id"], "skin", "skin.stl")
    job = client.wait(client.build_field(session["id"]))

Coordinates are patient LPS in mm. Every error answer of the service raises `Problem`.
"""

import http.client
import json
import os
import shutil
import urllib.parse
import uuid

__all__ = ["Client", "Problem", "JobFailed"]

_MEDIA_TYPES = {".stl": "model/stl", ".ply": "model/ply", ".obj": "model/obj", ".vtp": "model/vtp"}
_ENDED = ("succeeded", "failed", "cancelled")


class Problem(Exception):
    """An error answer of the service, an RFC 9457 problem.

    `status` is the HTTP status, `kind` the last part of the problem's type, and `document` the whole problem.
    """

    def __init__(self, status, document):
        self.status = status
        self.document = document
        self.kind = str(document.get("type", "about:blank")).rsplit("/", 1)[-1]
        lines = ["%s: %s" % (document.get("title", "error"), document.get("detail", ""))]
        lines += ["  %s: %s" % (e["pointer"], e["detail"]) for e in document.get("errors", [])]
        super().__init__("%d %s" % (status, "\n".join(lines)))


class JobFailed(Exception):
    """A job that failed or was cancelled; `job` is its view."""

    def __init__(self, job):
        self.job = job
        problem = job.get("problem") or {}
        super().__init__("job %s %s: %s" % (job["id"], job["status"], problem.get("detail", "")))


class Client:
    """A client of one service. Each call opens its own connection, so threads may share a client.

    `url` is `http://HOST:PORT` or `https://HOST:PORT`, `timeout_s` the timeout of a connection in seconds, and `token` an API key
    or a token of an identity provider.
    """

    def __init__(self, url, timeout_s=900.0, token=None):
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("expected http://HOST:PORT, found %r" % url)
        self._secure = parts.scheme == "https"
        self._host, self._port = parts.hostname, parts.port
        self._base = parts.path.rstrip("/")
        self._timeout_s = timeout_s
        self._authorization = {"Authorization": "Bearer " + token} if token else {}

    # ---- requests ----

    def _connection(self, timeout_s=None):
        kind = http.client.HTTPSConnection if self._secure else http.client.HTTPConnection
        return kind(self._host, self._port, timeout=timeout_s or self._timeout_s)

    def _open(self, method, path, body=None, headers=None):
        """Sends a request; returns the connection and the response. Raises `Problem` for an error answer."""
        connection = self._connection()
        try:
            try:
                connection.request(method, self._base + path, body=body, headers=dict(self._authorization, **(headers or {})))
            except (BrokenPipeError, ConnectionResetError):
                pass  # The service may have answered before the upload was complete.
            response = connection.getresponse()
            if response.status >= 400:
                text = response.read()
                try:
                    document = json.loads(text)
                except ValueError:
                    document = {"title": response.reason, "detail": text[:200].decode("utf-8", "replace")}
                raise Problem(response.status, document)
            return connection, response
        except BaseException:
            connection.close()
            raise

    def request(self, method, path, body=None, idempotency_key=None):
        """Sends a request with a JSON body; returns the JSON of the answer, or None if it has no body."""
        headers = {"Accept": "application/json"}
        data = None
        if body is not None:
            data = json.dumps(body, allow_nan=False).encode()
            headers["Content-Type"] = "application/json"
        if idempotency_key:
            headers["Idempotency-Key"] = idempotency_key
        connection, response = self._open(method, path, data, headers)
        try:
            text = response.read()
        finally:
            connection.close()
        return json.loads(text) if text else None

    def _create(self, path, body, idempotency_key=None):
        return self.request("POST", path, body, idempotency_key or str(uuid.uuid4()))

    def upload(self, path, filename):
        """Uploads a file unchanged, without reading it into memory; returns the JSON of the answer."""
        kind = _MEDIA_TYPES.get(os.path.splitext(filename)[1].lower(), "application/octet-stream")
        with open(filename, "rb") as file:
            length = os.fstat(file.fileno()).st_size
            headers = {"Content-Type": kind, "Content-Length": str(length)}
            connection, response = self._open("PUT", path, file, headers)
            try:
                return json.loads(response.read())
            finally:
                connection.close()

    def download(self, path, filename):
        """Writes the body of an answer to a file, which appears only when it is complete. Returns its media type."""
        connection, response = self._open("GET", path)
        part = str(filename) + ".part"
        try:
            with open(part, "wb") as file:
                shutil.copyfileobj(response, file, 1 << 20)
            os.replace(part, filename)
            return response.headers.get_content_type()
        finally:
            connection.close()
            if os.path.exists(part):
                os.remove(part)

    def get_bytes(self, path):
        connection, response = self._open("GET", path)
        try:
            return response.read()
        finally:
            connection.close()

    # ---- sessions and inputs ----

    def create_session(self, label=None, settings=None, idempotency_key=None):
        return self._create("/v1/sessions", _given(label=label, settings=settings), idempotency_key)

    def session(self, session):
        return self.request("GET", "/v1/sessions/%s" % session)

    def sessions(self):
        """Yields all sessions, newest first."""
        path = "/v1/sessions"
        while path:
            page = self.request("GET", path)
            yield from page["sessions"]
            path = page.get("next")

    def delete_session(self, session, at_once=False):
        """Deletes a session. Without `at_once`, `restore_session` can restore it for a limited time (default: a day)."""
        self.request("DELETE", "/v1/sessions/%s%s" % (session, "?at_once=true" if at_once else ""))

    def restore_session(self, session):
        return self.request("POST", "/v1/sessions/%s/restore" % session)

    def put_ct(self, session, filename, **levels):
        """Uploads a CT and returns the import job. Optional levels: `skin_hu`, `bone_hu` (HU) and `max_error_mm`."""
        query = "?" + urllib.parse.urlencode(levels) if levels else ""
        return self.upload("/v1/sessions/%s/ct%s" % (session, query), filename)

    def put_surface(self, session, part, filename):
        """Uploads a surface as part `skin`, `skull` or `target` and returns its report."""
        return self.upload("/v1/sessions/%s/%s" % (session, part), filename)

    def put_landmarks(self, session, landmarks):
        return self.request("PUT", "/v1/sessions/%s/landmarks" % session, landmarks)

    # ---- preparation ----

    def put_field_settings(self, session, **settings):
        return self.request("PUT", "/v1/sessions/%s/field/settings" % session, settings)

    def build_field(self, session, idempotency_key=None):
        return self._create("/v1/sessions/%s/field" % session, {}, idempotency_key)

    def build_mesh(self, session, idempotency_key=None, **settings):
        return self._create("/v1/sessions/%s/mesh" % session, settings, idempotency_key)

    def field(self, session):
        return self.request("GET", "/v1/sessions/%s/field" % session)

    def mesh(self, session):
        return self.request("GET", "/v1/sessions/%s/mesh" % session)

    def create_osteotomy(self, session, cuts=None, template=None, label=None, idempotency_key=None):
        body = _given(cuts=cuts, template=template, label=label)
        return self._create("/v1/sessions/%s/osteotomies" % session, body, idempotency_key)

    def create_plan(self, session, osteotomy, paths, label=None, idempotency_key=None):
        body = _given(osteotomy=osteotomy, paths=paths, label=label)
        return self._create("/v1/sessions/%s/plans" % session, body, idempotency_key)

    # ---- jobs ----

    def create_job(self, session, plan, idempotency_key=None, **options):
        """Starts a solve and returns its job. Options: model, steps, outputs, reference_job, preset, attachment."""
        return self._create("/v1/sessions/%s/jobs" % session, dict(options, plan=plan), idempotency_key)

    def job(self, job, wait_s=0):
        return self.request("GET", "/v1/jobs/%s?wait_s=%g" % (job, wait_s))

    def cancel(self, job):
        return self.request("POST", "/v1/jobs/%s/cancel" % job)

    def wait(self, job):
        """Waits until a job (its id or view) has ended. Returns its view; raises `JobFailed` if it did not succeed."""
        job = job["id"] if isinstance(job, dict) else job
        while True:
            view = self.job(job, wait_s=30)
            if view["status"] == "succeeded":
                return view
            if view["status"] in _ENDED:
                raise JobFailed(view)

    def events(self, job, last_event_id=0):
        """Yields the events of a job as they arrive, each {"id", "event", "data"}, up to its end.

        When the connection breaks, reconnects and continues after the last event.
        """
        while True:
            headers = {"Accept": "text/event-stream", "Last-Event-ID": str(last_event_id)}
            connection, response = self._open("GET", "/v1/jobs/%s/events" % job, None, headers)
            try:
                if response.status == 204:
                    return
                for event in _server_sent_events(response):
                    last_event_id = event["id"]
                    yield event
                    if event["event"] == "end":
                        return
            except (ConnectionError, http.client.IncompleteRead, TimeoutError):
                pass
            finally:
                connection.close()

    # ---- results ----

    def report(self, job):
        return self.request("GET", "/v1/jobs/%s/report" % job)

    def error(self, job, step):
        return self.request("GET", "/v1/jobs/%s/steps/%d/error" % (job, step))

    def download_skin(self, job, step, filename, format="glb"):
        return self.download("/v1/jobs/%s/steps/%d/skin?format=%s" % (job, step, format), filename)

    def frame(self, job, step):
        """Raw bytes of the frame of a step (format: api/frames.md)."""
        return self.get_bytes("/v1/jobs/%s/steps/%d/frame" % (job, step))

    def topology(self, job):
        """Raw bytes of the triangles, which all frames share (format: api/frames.md)."""
        return self.get_bytes("/v1/jobs/%s/topology" % job)

    def compare(self, prediction, reference, **options):
        """Compares two surfaces and returns the error map; waits when the service computes it as a job."""
        found = self.request("POST", "/v1/compare", dict(options, prediction=prediction, reference=reference))
        if "links" not in found:
            return found
        job = self.wait(found["id"])
        values = "?values=true" if options.get("values") else ""
        return self.request("GET", job["links"]["comparison"] + values)


def _given(**members):
    return {name: value for name, value in members.items() if value is not None}


def _server_sent_events(response):
    """Yields the complete events of a stream; an event cut off at its end is dropped."""
    event = {}
    for line in response:
        line = line.decode("utf-8").rstrip("\r\n")
        if not line:
            if "data" in event:
                yield {"id": int(event.get("id", 0)), "event": event.get("event"), "data": json.loads(event["data"])}
            event = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(":")
            value = value[1:] if value.startswith(" ") else value
            event[name] = event["data"] + "\n" + value if name == "data" and "data" in event else value
