#!/usr/bin/env python3
"""Whether a head that lies turned in the scanner gets the same cuts and the same face.

    turned_head.py PROSOPON HEAD [TURN ...]      HEAD: a folder with skin.stl and skull.stl, binary; TURN: degrees about x, y and z, as 10,0,-20

Starts the service; for each pose uploads the turned surfaces and nothing else, cuts Le Fort I and both rami by proposed landmarks, moves the upper
jaw 6 mm forward in the head's direction, and compares the face, turned back, with that of the head as it came. Needs no packages.
"""

import json
import math
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

TURNS = ["5,0,0", "10,0,0", "-10,0,0", "0,5,0", "0,10,0", "0,0,10", "0,0,20", "30,0,0", "25,-30,35", "0,0,180"]
MIDDLE = (0.0, 0.0, 50.0)
HEADER, TRIANGLE = 84, 50


class Service:
    def __init__(self, program, data):
        command = [program, "serve", "--listen", "127.0.0.1:0", "--data", data]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.address = re.search(r"listening on (\S+)", self.process.stdout.readline())[1] + "/v1"

    def send(self, method, path, body=None, raw=False):
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        kind = "application/octet-stream" if isinstance(body, bytes) else "application/json"
        request = urllib.request.Request(self.address + path, data, {"content-type": kind}, method=method)
        with urllib.request.urlopen(request, timeout=600) as answer:
            found = answer.read()
        return found if raw else json.loads(found)

    def done(self, accepted):
        while True:
            job = self.send("GET", "/jobs/" + accepted["id"])
            if job["status"] in ("succeeded", "failed", "cancelled"):
                return job
            time.sleep(0.2)


def turn_of(text):
    matrix = [[float(i == j) for j in range(3)] for i in range(3)]
    for axis, degrees in enumerate(map(float, text.split(","))):
        sin, cos = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        about = [[float(a == b) for b in range(3)] for a in range(3)]
        about[i][i], about[i][j], about[j][i], about[j][j] = cos, -sin, sin, cos
        matrix = [[sum(about[a][k] * matrix[k][b] for k in range(3)) for b in range(3)] for a in range(3)]
    return matrix


def turned(matrix, point):
    away = [p - m for p, m in zip(point, MIDDLE)]
    return [sum(r * a for r, a in zip(row, away)) + m for row, m in zip(matrix, MIDDLE)]


def corners(stl):
    count = struct.unpack_from("<I", stl, 80)[0]
    return [HEADER + TRIANGLE * t + 12 + 12 * corner for t in range(count) for corner in range(3)]


def turned_stl(path, matrix):
    stl = bytearray(path.read_bytes())
    for at in corners(stl):
        struct.pack_into("<3f", stl, at, *turned(matrix, struct.unpack_from("<3f", stl, at)))
    return bytes(stl)


def face(service, head, matrix):
    """Volumes of the segments by name, the regions' movement forward, and the corners of the face turned back."""
    session = "/sessions/" + service.send("POST", "/sessions", {})["id"]
    for part in ("skin", "skull"):
        service.send("PUT", "%s/%s" % (session, part), turned_stl(head / (part + ".stl"), matrix))
    templates = [{"name": name} for name in ("le_fort_1", "bsso_left", "bsso_right")]
    osteotomy = service.send("POST", session + "/osteotomies", {"templates": templates})
    volumes = {segment["name"]: segment["volume_mm3"] / 1000 for segment in osteotomy["segments"]}
    jaw = next(segment["id"] for segment in osteotomy["segments"] if segment["name"] == "maxilla")
    service.done(service.send("POST", session + "/field", {}))
    service.done(service.send("POST", session + "/mesh", {"osteotomy": osteotomy["id"], "edge_mm": 5}))
    forward = [-6 * row[1] for row in matrix]
    paths = [{"segment": jaw, "waypoints": [{"t": 1, "translation_mm": forward}]}]
    job = service.done(service.send("POST", session + "/jobs", {"plan": {"osteotomy": osteotomy["id"], "paths": paths}, "steps": 2}))
    if job["status"] != "succeeded":
        sys.exit(str(job.get("problem")))
    regions = service.send("GET", "/jobs/%s/report" % job["id"])["regions"]
    stl = service.send("GET", "/jobs/%s/steps/2/skin?format=stl" % job["id"], raw=True)
    back = [list(column) for column in zip(*matrix)]
    points = [turned(back, struct.unpack_from("<3f", stl, at)) for at in corners(stl)]
    return volumes, {name: regions[name]["forward_mm"] for name in ("upper_lip", "lower_lip", "nose")}, points


def main():
    program, head, turns = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3:] or TURNS
    with tempfile.TemporaryDirectory() as data:
        service = Service(program, data)
        try:
            first = None
            for text in ["0,0,0"] + turns:
                begin = time.time()
                try:
                    volumes, forward, points = face(service, head, turn_of(text))
                except urllib.error.HTTPError as error:
                    print("%-12s refused: %s" % (text, json.loads(error.read())["detail"]), flush=True)
                    continue
                first = first or points
                off = sorted(math.dist(p, q) for p, q in zip(first, points))
                mean, p95 = sum(off) / len(off), off[len(off) * 95 // 100]
                sizes = ", ".join("%s %.1f" % (name, volume) for name, volume in volumes.items() if name != "skull")
                lips = ", ".join("%s %.2f" % pair for pair in forward.items())
                print("%-12s off by %.3f mm (mean), %.3f (P95); forward mm: %s; cm3: %s; %.0f s" % (text, mean, p95, lips, sizes, time.time() - begin), flush=True)
        finally:
            service.process.terminate()
            service.process.wait()


main()
