#!/usr/bin/env python3
"""Runs operations from a raw CT to error maps without manual input; landmarks are proposed.

    raw_ct.py PROSOPON CT OUT [--operations le_fort_1 set_back genioplasty] [--steps 4] [--restart]

Starts the service on a free port of this machine, uploads the CT and, for each operation, cuts by templates, plans, solves
with the mixed and the linear model and compares the two. Writes to OUT pictures, reports, `times.csv` (wall time, processor
time of the service, stored bytes of the session after each phase) and `sizes.json` (bytes stored, sent and in memory). The
pictures show a face: keep OUT private. """

import argparse
import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "api" / "clients" / "python"))
from prosopon import Client  # noqa: E402

# For each operation: templates, name of the moving segment, its translation (LPS, mm), and regions of the skin to print.
OPERATIONS = {
    "le_fort_1": (["le_fort_1"], "maxilla", [0.0, -6.0, 0.0], ["upper_lip", "paranasal_left", "paranasal_right", "nose"]),
    "set_back": (["bsso_left", "bsso_right"], "mandible_distal", [0.0, 4.0, 0.0], ["lower_lip", "chin", "submental"]),
    "genioplasty": (["genioplasty"], "chin", [0.0, -6.0, 0.0], ["chin", "lower_lip", "submental"]),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("prosopon")
    parser.add_argument("ct", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--operations", nargs="*", choices=sorted(OPERATIONS), default=list(OPERATIONS))
    parser.add_argument("--steps", type=int, default=4)
    parser.add_argument("--restart", action="store_true", help="restart the service before each phase (empty memory)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as data, open(arguments.out / "service.log", "w") as log:
        service = Service(arguments.prosopon, pathlib.Path(data), log)
        try:
            run(Client(service.start()), arguments, service)
        finally:
            service.stop()


class Service:
    """The service; its address stays the same after a restart."""

    def __init__(self, program, data, log):
        self.program, self.data, self.log, self.listen = program, data, log, "127.0.0.1:0"

    def start(self):
        note = self.data / "listen"
        note.unlink(missing_ok=True)
        command = [self.program, "serve", "--listen", self.listen, "--data", str(self.data)]
        self.process = subprocess.Popen(command, stdout=self.log, stderr=self.log)
        while not note.exists():
            if self.process.poll() is not None:
                sys.exit("raw_ct: the service ended; see service.log")
            time.sleep(0.05)
        url = note.read_text().strip()
        self.listen = url.split("//")[1]
        return url

    def stop(self):
        self.process.terminate()
        self.process.wait()


class Times:
    """For each phase: wall time, processor time of the service, and stored bytes of the session after it."""

    def __init__(self, service, restart, stored):
        self.service, self.restart, self.stored, self.rows = service, restart, stored, []

    def take(self, operation, phase, work):
        if self.restart:
            self.service.stop()
            self.service.start()
        begun, worked = time.monotonic(), self.processor()
        result = work()
        wall, worked = time.monotonic() - begun, self.processor() - worked
        self.rows.append((operation, phase, round(wall, 2), round(worked, 2), self.stored()))
        print("%-12s %-10s %7.2f s, processor %7.2f s, stored %d bytes" % self.rows[-1], flush=True)
        return result

    def processor(self):
        """User and system time of all threads, s."""
        fields = pathlib.Path("/proc/%d/stat" % self.service.process.pid).read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(client, arguments, service):
    session = client.create_session(label="raw_ct.py")["id"]
    times = Times(service, arguments.restart, lambda: client.session(session)["bytes"])
    imported = times.take("", "import", lambda: client.wait(client.put_ct(session, str(arguments.ct))))
    tell(imported)
    landmarks = times.take("", "landmarks", lambda: client.request("GET", "/v1/sessions/%s/landmarks?propose=true" % session))
    print(json.dumps(landmarks))
    landmarks.pop("proposed")
    client.put_landmarks(session, landmarks)
    tell(times.take("", "field", lambda: client.wait(client.build_field(session))))
    for name in arguments.operations:
        try:
            operate(client, arguments, session, name, times)
        except Exception as error:  # noqa: BLE001
            print("%s failed: %s" % (name, error), flush=True)
    with open(arguments.out / "times.csv", "w", newline="") as file:
        csv.writer(file).writerows([("operation", "phase", "wall_s", "processor_s", "stored_bytes")] + times.rows)
    found = sizes(client, session, service)
    (arguments.out / "sizes.json").write_text(json.dumps(found, indent=1))
    print(json.dumps(found))


def sizes(client, session, service):
    """Bytes of a session in files and database, bytes sent to a client that follows its jobs, and peak memory of the process."""
    view = client.session(session)
    jobs = {}
    for job in view["jobs"]:
        jobs.setdefault(job["kind"], []).append(len(client.get_bytes("/v1/jobs/%s/events" % job["id"])))
    solved = next((job["id"] for job in view["jobs"] if job["kind"] == "solve"), None)
    data, status = service.data, pathlib.Path("/proc/%d/status" % service.process.pid).read_text()
    memory = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return {
        "session": view["bytes"],
        "parts": {name: part["bytes"] for name, part in view["parts"].items() if part["bytes"]},
        "blobs": sum(f.stat().st_size for f in (data / "blobs").rglob("*") if f.is_file()),
        "blob_count": sum(f.is_file() for f in (data / "blobs").rglob("*")),
        "rows": sum(f.stat().st_size for f in data.glob("prosopon.sqlite*")),
        "audit": sum(f.stat().st_size for f in (data / "audit").glob("*")),
        "event_streams": jobs,
        "frame": len(client.frame(solved, 1)) if solved else None,
        "topology": len(client.topology(solved)) if solved else None,
        "peak_memory": int(memory.split()[1]) * 1024,
    }


def operate(client, arguments, session, name, times):
    templates, segment_name, way, regions = OPERATIONS[name]
    out = arguments.out / name
    out.mkdir(exist_ok=True)
    body = {"templates": [{"name": t} for t in templates]}
    cut = times.take(name, "cut", lambda: client.request("POST", "/v1/sessions/%s/osteotomies" % session, body))
    for segment in cut["segments"]:
        print("   segment %d %s: %.1f cm3" % (segment["id"], segment["name"], segment["volume_mm3"] / 1000))
    tell(cut)
    moving = next(s["id"] for s in cut["segments"] if s["id"] and (s["name"] or "") == segment_name)
    tell(times.take(name, "mesh", lambda: client.wait(client.build_mesh(session, osteotomy=cut["id"]))))
    paths = [{"segment": moving, "waypoints": [{"t": 1.0, "translation_mm": way}]}]
    plan = times.take(name, "plan", lambda: client.create_plan(session, cut["id"], paths))
    job = times.take(name, "solve", lambda: client.wait(client.create_job(session, plan["id"], steps=arguments.steps, model="mixed")))
    tell(job)
    linear = times.take(name, "linear", lambda: client.wait(client.create_job(
        session, plan["id"], steps=arguments.steps, model="linear", reference_job=job["id"])))
    report = client.report(job["id"])
    (out / "report.json").write_text(json.dumps(report, indent=1))
    for region in regions:
        moved = report["regions"].get(region)
        if moved:
            print("   %-16s forward %6.2f, down %6.2f, left %6.2f mm" % (
                region, moved["forward_mm"], moved["down_mm"], moved["left_mm"]))
    last = "/v1/jobs/%s/steps/%d" % (linear["id"], arguments.steps)
    times.take(name, "error map", lambda: client.download(last + "/error.png", out / "error.png"))
    error = client.error(linear["id"], arguments.steps)
    print("   linear against mixed: mean absolute %.3f, P95 %.3f, max %.3f mm" % tuple(
        error["whole"][key] for key in ("mean_abs_mm", "p95_mm", "max_mm")))
    for job_id, page in ((job["id"], "report.html"), (linear["id"], "report_linear.html")):
        times.take(name, "report", lambda: client.download("/v1/jobs/%s/report?format=html" % job_id, out / page))
    client.download_skin(job["id"], arguments.steps, out / "skin.ply", format="ply")
    client.download("/v1/sessions/%s/skin?format=ply" % session, out / "before.ply")


def tell(answer):
    for warning in answer.get("warnings", []):
        print("   " + warning["message"])


if __name__ == "__main__":
    main()
