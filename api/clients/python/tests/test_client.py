"""Unit tests of the client against a local server: python3 -m unittest discover api/clients/python/tests"""

import array
import json
import os
import pathlib
import sys
import tempfile
import threading
import time
import unittest
from unittest import mock

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
from prosopon import Client, JobFailed, Problem, Unreachable, decode_frame, decode_topology  # noqa: E402
from prosopon import _follow, _transport  # noqa: E402
from server import Server, answer, problem, stream  # noqa: E402


def view(status="succeeded", job="j1", **members):
    return {"id": job, "status": status, "links": {"self": "/v1/jobs/" + job, "events": "/e"}, **members}


def event(number, name, **data):
    return {"id": number, "event": name, "data": data}


def end(number, status="succeeded", **members):
    return event(number, "end", status=status, links={"self": "/"}, **members)


class Fast(unittest.TestCase):
    """Tests that need not wait as long as a user."""

    def setUp(self):
        for module, name, value in (
            (_transport, "_REPEAT_AFTER_S", (0.01, 0.01, 0.01, 0.01)),
            (_transport, "_LONGEST_ASKED_S", 0.05),
            (_follow, "_FIRST_WAIT_S", 0.02),
            (_follow, "_LONGEST_WAIT_S", 0.05),
        ):
            patch = mock.patch.object(module, name, value)
            patch.start()
            self.addCleanup(patch.stop)


class Requests(Fast):
    def test_a_creation_sends_its_members_and_a_key(self):
        with Server([answer({"id": "s1"}, 201)]) as server:
            self.assertEqual(Client(server.url + "/").create_session(label="case 1"), {"id": "s1"})
            method, path, headers, body = server.requests[0]
            self.assertEqual((method, path, json.loads(body)), ("POST", "/v1/sessions", {"label": "case 1"}))
            self.assertTrue(headers["Idempotency-Key"])
            self.assertNotIn("Authorization", headers)

    def test_the_token_may_change_between_requests(self):
        tokens = iter(["a", "b"])
        with Server([answer({}), answer({})]) as server:
            client = Client(server.url, token=lambda: next(tokens))
            client.get_session("s")
            client.get_session("s")
            self.assertEqual([r[2]["Authorization"] for r in server.requests], ["Bearer a", "Bearer b"])

    def test_path_values_are_quoted_and_absent_queries_left_out(self):
        path = Client.path("/v1/jobs/{job}", {"wait_s": 2.5, "at_once": True, "before": None}, job="a/b c")
        self.assertEqual(path, "/v1/jobs/a%2Fb%20c?wait_s=2.5&at_once=true")

    def test_a_problem_has_type_title_detail_and_errors(self):
        errors = [{"pointer": "/paths/0", "detail": "must not be empty"}]
        with Server([problem("invalid-request", 422, errors=errors, request_id="r1")]) as server:
            with self.assertRaises(Problem) as caught:
                Client(server.url).create_plan("s", None, [])
        found = caught.exception
        self.assertEqual((found.type, found.kind, found.status), ("/problems/invalid-request", "invalid-request", 422))
        self.assertEqual((found.title, found.detail, found.errors), ("Title", "What to do.", errors))
        self.assertEqual(found.request_id, "r1")
        self.assertIn("/paths/0: must not be empty", str(found))

    def test_a_proxys_answer_gets_its_status_line(self):
        found = Problem.parse(b"<html>", 404, "Not Found", "Wed, 21 Oct 2026 07:28:00 GMT")
        self.assertEqual((found.kind, found.title, found.detail), ("about:blank", "Not Found", "<html>"))

    def test_a_creation_is_repeated_with_the_same_key(self):
        busy = problem("queue-full", 503, headers=[("Retry-After", "30")])
        with Server([busy, (502, "text/html", b"proxy"), answer(view())]) as server:
            Client(server.url).solve("s", "p", steps=3)
            keys = {r[2]["Idempotency-Key"] for r in server.requests}
            self.assertEqual((len(server.requests), len(keys)), (3, 1))

    def test_other_writes_are_not_repeated(self):
        with Server([problem("queue-full", 503)]) as server:
            with self.assertRaises(Problem):
                Client(server.url).put_landmarks("s", {"points": {}})
            self.assertEqual(len(server.requests), 1)

    def test_without_a_server_a_call_is_unreachable(self):
        with Server([]) as server:
            url = server.url
        with self.assertRaisesRegex(Unreachable, "does not answer"):
            Client(url).get_session("s")

    def test_an_answer_in_another_format(self):
        with Server([answer({"triangles": 4}), (200, "model/stl", b"solid"), (200, "text/html", b"<p>")]) as server:
            client = Client(server.url)
            self.assertEqual(client.get_skin("s")["triangles"], 4)
            self.assertEqual(client.get_skin("s", format="stl"), b"solid")
            self.assertEqual(client.report_html("j"), "<p>")
            paths = [r[1] for r in server.requests]
            self.assertEqual(paths[0], "/v1/sessions/s/skin?format=json")
            self.assertEqual(paths[2], "/v1/jobs/j/report?format=html")

    def test_sessions_are_read_page_by_page(self):
        pages = [answer({"sessions": [{"id": "b"}], "next": "/v1/sessions?before=b"}), answer({"sessions": [{"id": "a"}]})]
        with Server(pages) as server:
            self.assertEqual([s["id"] for s in Client(server.url).sessions()], ["b", "a"])

    def test_a_comparison_that_becomes_a_job_is_awaited(self):
        answers = [answer(view("accepted"), 202), stream(end(1)), answer(view()), answer({"values_mm": [1.0]})]
        with Server(answers) as server:
            found = Client(server.url).compare({"job": "j", "step": 1}, {"session": "s", "part": "target"}, values=True)
            self.assertEqual(found, {"values_mm": [1.0]})
            self.assertEqual(server.requests[-1][1], "/v1/jobs/j1/comparison?format=json&values=true")


class Files(Fast):
    def test_an_upload_streams_and_reports_its_progress(self):
        content = os.urandom(300_000)
        with tempfile.TemporaryDirectory() as folder, Server([answer({"triangles": 1}), answer({})]) as server:
            path = pathlib.Path(folder, "skin.stl")
            path.write_bytes(content)
            seen = []
            client = Client(server.url)
            client.put_surface("s", "skin", path, lambda sent, total: seen.append((sent, total)))
            client.put_ct("s", b"bytes", skin_hu=-300.0)
            self.assertEqual(server.requests[0][3], content)
            self.assertEqual(server.requests[0][2]["Content-Type"], "model/stl")
            self.assertGreater(len(seen), 2)
            self.assertEqual(seen[-1], (300_000, 300_000))
            self.assertEqual(server.requests[1][1], "/v1/sessions/s/ct?skin_hu=-300.0")

    def test_a_download_that_breaks_off_leaves_no_file(self):
        def short(handler):
            handler.send_response(200)
            handler.send_header("Content-Length", "100")
            handler.end_headers()
            handler.wfile.write(b"x" * 10)
            handler.close_connection = True

        with tempfile.TemporaryDirectory() as folder, Server([short, (200, "model/gltf-binary", b"glTF")]) as server:
            path = os.path.join(folder, "skin.glb")
            with self.assertRaises(Unreachable):
                Client(server.url).download_skin("j", 1, path)
            self.assertEqual(os.listdir(folder), [])
            self.assertEqual(Client(server.url).download_skin("j", 1, path), "model/gltf-binary")
            self.assertEqual(pathlib.Path(path).read_bytes(), b"glTF")

    def test_frames_are_decoded(self):
        data = array.array("f", [1, 2, 3, 4, 5, 6, 0.5, 0.25, -1, 1]).tobytes()
        frame = decode_frame(data, 2)
        self.assertEqual(list(frame.positions_mm), [1, 2, 3, 4, 5, 6])
        self.assertEqual((list(frame.displacement_mm), list(frame.error_mm or [])), ([0.5, 0.25], [-1, 1]))
        self.assertIsNone(decode_frame(data[:32], 2).error_mm)
        self.assertRaises(ValueError, decode_frame, data, 3)
        self.assertEqual(list(decode_topology(array.array("I", [0, 1, 2]).tobytes())), [0, 1, 2])


class Following(Fast):
    def test_a_broken_stream_goes_on_after_the_last_event(self):
        first = stream(event(1, "status"), event(2, "step", k=1), event(2, "heartbeat"), cut=b'{"id": 3, "ev')
        with Server([first, stream(event(3, "step", k=2), event(4, "novel"), end(5))]) as server:
            waits = []
            events = list(Client(server.url).follow("j", on_interruption=waits.append))
            self.assertEqual([e["id"] for e in events], [1, 2, 3, 5])
            self.assertEqual([r[2]["Last-Event-ID"] for r in server.requests], ["0", "2"])
            self.assertEqual(len(waits), 1)

    def test_a_server_that_goes_away_for_some_time(self):
        server = Server([stream(event(7, "step", k=1))])
        port, after = server.port, []
        client = Client(server.url)
        events = client.follow("j", after=6)
        self.assertEqual(next(events)["id"], 7)
        self.assertEqual(server.requests[0][2]["Last-Event-ID"], "6")
        server.close()

        def restart():
            time.sleep(0.5)
            after.append(Server([problem("shutting-down", 503), stream(end(8))], port))

        thread = threading.Thread(target=restart)
        thread.start()
        self.assertEqual([e["id"] for e in events], [8])
        thread.join()
        self.assertEqual([r[2]["Last-Event-ID"] for r in after[0].requests], ["7", "7"])
        after[0].close()

    def test_a_job_that_was_continued_is_followed_on(self):
        streams = [stream(event(5, "step"), end(6, continued_by="j2")), stream(event(1, "step"), end(2))]
        with Server(streams + [answer(view(job="j2"))]) as server:
            seen = []
            self.assertEqual(Client(server.url).finished("j1", on_event=seen.append)["id"], "j2")
            self.assertEqual([e["id"] for e in seen], [5, 6, 1, 2])
            paths = ["/v1/jobs/j1/events", "/v1/jobs/j2/events", "/v1/jobs/j2"]
            self.assertEqual([r[1] for r in server.requests], paths)
            self.assertEqual(server.requests[1][2]["Last-Event-ID"], "0")

    def test_a_job_whose_events_were_all_sent(self):
        def nothing(handler):
            handler.send_response(204)
            handler.end_headers()

        with Server([nothing, answer(view("cancelled"))]) as server:
            (last,) = Client(server.url).follow("j1", after=9)
            self.assertEqual((last["event"], last["id"], last["data"]["status"]), ("end", 9, "cancelled"))

    def test_a_refusal_ends_the_stream(self):
        with Server([problem("not-found", 404)]) as server:
            self.assertRaises(Problem, list, Client(server.url).follow("j"))

    def test_a_failed_job_raises(self):
        failed = view("failed", problem={"detail": "Newton stopped."})
        with Server([stream(end(1, "failed")), answer(failed)]) as server:
            with self.assertRaisesRegex(JobFailed, "Newton stopped"):
                Client(server.url).wait(view("running"))


class Document(unittest.TestCase):
    def test_every_operation_has_its_method(self):
        document = json.loads((HERE / "../../../openapi.json").read_text())
        for methods in document["paths"].values():
            for operation in methods.values():
                name = "".join("_" + c.lower() if c.isupper() else c for c in operation["operationId"])
                self.assertTrue(callable(getattr(Client, name, None)), name)


if __name__ == "__main__":
    unittest.main()
