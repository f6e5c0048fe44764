#!/usr/bin/env python3
"""Records the answers in answers/, the examples of the OpenAPI document, in a run of the service on the phantom.

    record.py PROGRAM PHANTOM [CT]      PHANTOM: the folder `phantom` that `prosopon demo` writes; CT: any CT, for the answer to one

Needs no packages; a minute. Ids are counted up from one, and long lists keep two entries, so that a page can show them. An answer that does not
fit its schema fails tests/openapi/run.
"""

import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

HERE = pathlib.Path(__file__).resolve().parent
ID = "0197a2c0-0000-7000-8000-%012d"
UUID = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}")
# A point has three numbers and a quaternion four: longer lists are lists of things.
LONGEST = 4


class Recorder:
    """Sends requests by operation, and keeps the answers."""

    def __init__(self, address):
        self.address = address
        document = json.loads((HERE / "../openapi.json").read_text(encoding="utf-8"))
        self.places = {o["operationId"]: (m.upper(), p) for p, item in document["paths"].items() for m, o in item.items()}
        self.ids = {}

    def send(self, operation, body=None, query="", **headers):
        method, path = self.places[operation]
        path = path.format(**self.ids) + query
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        kind = "application/octet-stream" if isinstance(body, bytes) else "application/json"
        headers = {"Content-Type": kind, **{name.replace("_", "-"): value for name, value in headers.items()}}
        request = urllib.request.Request(self.address + path, data, headers, method=method)
        try:
            with urllib.request.urlopen(request) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            sys.exit("%s %s: %s" % (method, path, error.read().decode()[:500]))

    def __call__(self, operation, body=None, query="", **headers):
        answer = json.loads(self.send(operation, body, query, **headers))
        self.keep(operation, answer)
        return answer

    def keep(self, operation, answer):
        text = json.dumps(shortened(answer), indent=2, ensure_ascii=False)
        numbers = {}
        text = UUID.sub(lambda found: ID % numbers.setdefault(found.group(), len(numbers) + 1), text)
        (HERE / "answers" / (operation + ".json")).write_text(text + "\n", encoding="utf-8")

    def finish(self, job):
        self.ids["job"] = job["id"]
        while True:
            view = json.loads(self.send("getJob", query="?wait_s=20"))
            if view["status"] == "succeeded":
                if view["kind"] == "solve":
                    self.keep("getJob", view)
                return view
            if view["status"] not in ("accepted", "running", "interrupted"):
                sys.exit("the job ended as %s: %s" % (view["status"], view.get("problem")))


def shortened(value):
    if isinstance(value, dict):
        return {name: shortened(member) for name, member in value.items()}
    if isinstance(value, list):
        return [shortened(one) for one in (value if len(value) <= LONGEST else value[:2])]
    return round(value, 4) if isinstance(value, float) else value


def record(call, phantom, ct):
    file = lambda name: (phantom / name).read_bytes()
    example = lambda name: json.loads((HERE / (name + ".json")).read_text(encoding="utf-8"))["body"]
    call("listMaterials"), call("listTemplates"), call("checkMaterial", example("check_material"))
    if ct:
        call.ids["session"] = call("createSession", {"label": "CT"})["id"]
        call.finish(call("putCt", ct.read_bytes()))
    session = call.ids["session"] = call("createSession", {"label": "case 17"})["id"]
    call("putSkin", file("skin.stl")), call("putSkull", file("skull.stl")), call("putTarget", file("skin.stl"))
    for part in ("getSkin", "getSkull", "getTarget"):
        call(part, query="?format=json")
    call("putLandmarks", json.loads(file("landmarks.json"))), call("getLandmarks")
    frame = call("getFrame")
    call("putFrame", {name: frame[name] for name in ("left", "back", "up", "origin_mm")}), call.send("deleteFrame")
    call("putFieldSettings", example("field_settings"))
    call.finish(call("buildField", {}))
    call("getField"), call("queryField", example("field_query"))
    cuts = {"template": {"name": "le_fort_1"}}
    call("previewOsteotomy", cuts)
    osteotomy = call.ids["osteotomy"] = call("createOsteotomy", cuts)["id"]
    call("listOsteotomies"), call("getOsteotomy")
    call.finish(call("buildMesh", {"osteotomy": osteotomy, "edge_mm": 7}))
    call("getMesh")
    paths = [{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0, -5, 0]}]}]
    call.ids["plan"] = call("createPlan", {"osteotomy": osteotomy, "paths": paths})["id"]
    call("getPlan"), call("listPlans")
    call.finish(call("solve", {"plan": call.ids["plan"], "steps": 2, "outputs": ["tissue", "error"]}))
    solved, call.ids["k"] = call.ids["job"], 1
    call("getReport"), call("getStepError"), call("listJobs"), call("createLink", {"path": "/v1/jobs/%s/report" % solved})
    lines = call.send("followJob", Accept="application/x-ndjson").decode().splitlines()
    step = next(line for line in lines if '"event":"step"' in line)
    call.keep("followJob", json.loads(step))
    tissue = call.send("getDeformedTissue")
    call("getSession")
    compared = {"prediction": {"job": solved, "step": 2}, "reference": {"session": session, "part": "target"}}
    call("compare", compared, Prefer="wait=60")
    started = json.loads(call.send("compare", {**compared, "values": True}, Prefer="wait=0"))
    call.ids["job"] = started.get("id", solved)
    if "id" in started:
        call.finish(started)
        call("getComparison")
    call.ids["session"] = call("createSession", {"label": "ready mesh"})["id"]
    call("putTissue", tissue), call("getTissue", query="?format=json")
    call.ids["segment"] = 1
    call("putBone", file("skull.stl")), call("getBone", query="?format=json")
    call.send("deleteSession")
    call("restoreSession"), call("listSessions", query="?limit=2")
    call.ids["session"] = session
    waiting = json.loads(call.send("solve", {"plan": call.ids["plan"], "steps": 200}))
    call.ids["job"] = waiting["id"]
    call("cancelJob")


def main():
    program, phantom = sys.argv[1], pathlib.Path(sys.argv[2])
    ct = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = "127.0.0.1:%d" % free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        service = subprocess.Popen([program, "serve", "--data", folder, "--listen", address], stderr=subprocess.DEVNULL)
        try:
            for _ in range(100):
                try:
                    urllib.request.urlopen("http://%s/readyz" % address).close()
                    break
                except OSError:
                    time.sleep(0.1)
            record(Recorder("http://" + address), phantom, ct)
        finally:
            service.terminate()
            service.wait()


if __name__ == "__main__":
    main()
