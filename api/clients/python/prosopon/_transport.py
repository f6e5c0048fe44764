"""Requests over HTTP: addresses, token, repetition, uploads and downloads."""

from __future__ import annotations

import http.client
import io
import json
import os
import shutil
import time
import urllib.parse
import uuid
from typing import IO, Any, Callable, Dict, Iterator, Mapping, Optional, Tuple, Union

from ._problem import Problem, Unreachable

#: File to upload: its path, or its content.
Source = Union[str, "os.PathLike[str]", bytes]
#: Called with the bytes that were sent and the bytes of the file.
Progress = Callable[[int, int], None]
Token = Union[str, Callable[[], Optional[str]], None]

_MEDIA_TYPES = {".stl": "model/stl", ".ply": "model/ply", ".obj": "model/obj", ".vtp": "model/vtp"}
_REPEAT_AFTER_S = (0.5, 1.0, 2.0, 4.0)
_LONGEST_ASKED_S = 10.0
_BLOCK = 1 << 16
# A connection that broke, also in the middle of an answer. `OSError` includes refusals, resets and timeouts.
BROKEN = (OSError, http.client.HTTPException)


class Transport:
    """Sends requests with the token and raises `Problem` for error answers. Each request has its own connection."""

    def __init__(self, url: str, timeout_s: float = 900.0, token: Token = None) -> None:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("the address of the service must be http://HOST:PORT or https://HOST:PORT, found %r" % url)
        self._secure = parts.scheme == "https"
        self._host, self._port = parts.hostname, parts.port
        self._base = parts.path.rstrip("/")
        self._url = "%s://%s%s" % (parts.scheme, parts.netloc, self._base)
        self._timeout_s = timeout_s
        self._token = token

    def url(self, path: str) -> str:
        """Address of a path of the API."""
        return self._url + path

    @staticmethod
    def path(template: str, query: Optional[Mapping[str, object]] = None, **values: object) -> str:
        """Fills the names in braces and appends the query; values that are None are left out."""
        filled = template.format(**{name: urllib.parse.quote(str(value), safe="") for name, value in values.items()})
        pairs = [(name, _text(value)) for name, value in (query or {}).items() if value is not None]
        return filled + ("?" + urllib.parse.urlencode(pairs) if pairs else "")

    def open(
        self,
        method: str,
        path: str,
        body: Union[bytes, IO[bytes], None] = None,
        headers: Optional[Mapping[str, str]] = None,
        timeout_s: Optional[float] = None,
    ) -> Tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
        """Sends one request. The caller closes the connection.

        Raises `Problem` for an error answer and `Unreachable` without an answer.
        """
        kind = http.client.HTTPSConnection if self._secure else http.client.HTTPConnection
        connection = kind(self._host, self._port, timeout=timeout_s or self._timeout_s, blocksize=_BLOCK)
        try:
            try:
                connection.request(method, self._base + path, body=body, headers=self._headers(headers))
            except (BrokenPipeError, ConnectionResetError):
                pass  # The service may have answered before the upload was complete.
            response = connection.getresponse()
            if response.status >= 400:
                text = response.read()
                raise Problem.parse(text, response.status, response.reason, response.headers.get("Retry-After"))
            return connection, response
        except BROKEN as cause:
            connection.close()
            raise Unreachable(self.url(path), cause) from cause
        except BaseException:
            connection.close()
            raise

    def request(self, method: str, path: str, body: object = None, idempotency_key: Optional[str] = None) -> Any:
        """Sends a request with a JSON body; returns the JSON of the answer, or None if it has no body.

        Reads, and requests with an idempotency key, are repeated while the service is away.
        """
        headers = {"Accept": "application/json"}
        data = None
        if body is not None:
            data = json.dumps(body, allow_nan=False).encode()
            headers["Content-Type"] = "application/json"
        if idempotency_key:
            headers["Idempotency-Key"] = idempotency_key
        text = self._read(method, path, data, headers, repeat=method == "GET" or idempotency_key is not None)
        return json.loads(text) if text else None

    def create(self, path: str, body: object, idempotency_key: Optional[str] = None) -> Any:
        """Sends a POST that the service carries out once, however often it arrives."""
        return self.request("POST", path, body, idempotency_key or str(uuid.uuid4()))

    def upload(self, path: str, file: Source, on_progress: Optional[Progress] = None) -> Any:
        """Sends a file unchanged, in blocks, without reading it into memory; returns the JSON of the answer."""
        name = "" if isinstance(file, bytes) else os.fspath(file)
        kind = _MEDIA_TYPES.get(os.path.splitext(name)[1].lower(), "application/octet-stream")
        with io.BytesIO(file) if isinstance(file, bytes) else open(file, "rb") as source:
            total = source.seek(0, os.SEEK_END)
            source.seek(0)
            headers = {"Accept": "application/json", "Content-Type": kind, "Content-Length": str(total)}
            body = _Counted(source, total, on_progress)
            connection, response = self.open("PUT", path, body, headers)  # type: ignore[arg-type]
            try:
                return json.loads(response.read())
            finally:
                connection.close()

    def download(self, path: str, filename: Union[str, "os.PathLike[str]"]) -> str:
        """Writes the body of an answer to a file, which appears only when it is complete. Returns its media type."""
        connection, response = self.open("GET", path)
        part = os.fspath(filename) + ".part"
        try:
            with open(part, "wb") as file:
                shutil.copyfileobj(response, file, 1 << 20)
            # `copyfileobj` takes a body that broke off for complete.
            if response.length:
                raise Unreachable(self.url(path), "the answer broke off")
            os.replace(part, filename)
            return response.headers.get_content_type()
        finally:
            connection.close()
            if os.path.exists(part):
                os.remove(part)

    def get_bytes(self, path: str) -> bytes:
        """Reads a binary result."""
        return self._read("GET", path, None, {}, repeat=True)

    def get_text(self, path: str) -> str:
        """Reads a text result."""
        return self.get_bytes(path).decode("utf-8")

    def _headers(self, headers: Optional[Mapping[str, str]]) -> Dict[str, str]:
        token = self._token() if callable(self._token) else self._token
        return {**({"Authorization": "Bearer " + token} if token else {}), **(headers or {})}

    def _read(self, method: str, path: str, data: Optional[bytes], headers: Mapping[str, str], repeat: bool) -> bytes:
        for wait_s in _REPEAT_AFTER_S if repeat else ():
            try:
                return self._read_once(method, path, data, headers)
            except Unreachable:
                asked = 0.0
            except Problem as problem:
                if not problem.passing:
                    raise
                asked = problem.retry_after_s or 0.0
            time.sleep(max(wait_s, min(asked, _LONGEST_ASKED_S)))
        return self._read_once(method, path, data, headers)

    def _read_once(self, method: str, path: str, data: Optional[bytes], headers: Mapping[str, str]) -> bytes:
        connection, response = self.open(method, path, data, headers)
        try:
            return response.read()
        except BROKEN as cause:
            raise Unreachable(self.url(path), cause) from cause
        finally:
            connection.close()


class _Counted:
    """A file that reports how much of it was read. `http.client` reads it in blocks."""

    def __init__(self, file: IO[bytes], total: int, on_progress: Optional[Progress]) -> None:
        self._file, self._total, self._on_progress = file, total, on_progress

    def read(self, size: int = -1) -> bytes:
        block = self._file.read(size)
        if block and self._on_progress:
            self._on_progress(self._file.tell(), self._total)
        return block

    def __iter__(self) -> Iterator[bytes]:
        return iter(lambda: self.read(_BLOCK), b"")


def given(**members: object) -> Dict[str, object]:
    """Members that are not None."""
    return {name: value for name, value in members.items() if value is not None}


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
