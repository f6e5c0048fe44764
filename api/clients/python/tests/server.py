"""A local HTTP server whose answers the tests prescribe."""

import http.server
import json
import threading

PROBLEM = "application/problem+json"


class Server:
    """Answers each request with the next answer of its list and records the requests.

    An answer is a function of the handler, or (status, media type, body, headers).
    """

    def __init__(self, answers, port=0):
        self.answers = list(answers)
        self.requests = []
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def serve(self):
                length = int(self.headers.get("Content-Length") or 0)
                outer.requests.append((self.command, self.path, dict(self.headers), self.rfile.read(length)))
                answer = outer.answers.pop(0)
                if callable(answer):
                    return answer(self)
                send(self, *answer)

            do_GET = do_POST = do_PUT = do_DELETE = serve

            def log_message(self, *_):
                pass

        self.http = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.port = self.http.server_address[1]
        self.url = "http://127.0.0.1:%d" % self.port
        threading.Thread(target=self.http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.http.shutdown()
        self.http.server_close()


def send(handler, status, media="application/json", body=b"", headers=()):
    handler.send_response(status)
    handler.send_header("Content-Type", media)
    handler.send_header("Content-Length", str(len(body)))
    for name, value in headers:
        handler.send_header(name, value)
    handler.end_headers()
    handler.wfile.write(body)


def answer(value, status=200):
    return (status, "application/json", json.dumps(value).encode())


def problem(kind, status, headers=(), **members):
    document = {"type": "/problems/" + kind, "title": "Title", "status": status, "detail": "What to do.", **members}
    return (status, PROBLEM, json.dumps(document).encode(), headers)


def stream(*events, cut=b""):
    """A stream of events that ends with the connection; `cut` is the start of a line that breaks off."""

    def write(handler):
        handler.send_response(200)
        handler.send_header("Content-Type", "application/x-ndjson")
        handler.end_headers()
        for event in events:
            handler.wfile.write(json.dumps(event).encode() + b"\n")
        handler.wfile.write(cut)
        handler.close_connection = True

    return write
