#!/usr/bin/env python3
"""Runs the main job: from surfaces or a CT to deformed skins and a report.

    main_job.py URL --skin FILE --skull FILE --landmarks FILE --out DIR
    main_job.py URL --ct FILE --landmarks FILE --out DIR
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from prosopon import Client, JobFailed, Problem  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("url")
    parser.add_argument("--skin")
    parser.add_argument("--skull")
    parser.add_argument("--target", help="postoperative skin, for error maps")
    parser.add_argument("--ct")
    parser.add_argument("--landmarks", required=True, help="JSON file with the body of PUT …/landmarks")
    parser.add_argument("--forward-mm", type=float, default=6.0)
    parser.add_argument("--down-mm", type=float, default=1.5)
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--model", default="auto")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    if not arguments.ct and not (arguments.skin and arguments.skull):
        parser.error("give --ct, or --skin and --skull")
    try:
        run(arguments)
    except (Problem, JobFailed) as problem:
        sys.exit("main_job: %s" % problem)


def run(arguments):
    client = Client(arguments.url)
    out = pathlib.Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    session = client.create_session(label="main_job.py")["id"]

    if arguments.ct:
        follow(client, client.put_ct(session, arguments.ct))
    else:
        for part in ("skin", "skull"):
            report = client.put_surface(session, part, getattr(arguments, part))
            print("%s: %d triangles, closed: %s" % (part, report["triangles"], report["closed"]))
    if arguments.target:
        client.put_surface(session, "target", arguments.target)
    client.put_landmarks(session, json.loads(pathlib.Path(arguments.landmarks).read_text()))

    follow(client, client.build_field(session))
    osteotomy = client.create_osteotomy(session, template={"name": "le_fort_1"})
    print("segments:", ["%.1f cm3" % (s["volume_mm3"] / 1000) for s in osteotomy["segments"]])
    # The template's first cut is the Le Fort I plane; a lower jaw that was connected at the teeth is not bounded by it.
    upper_jaw = next(s["id"] for s in osteotomy["segments"] if s["id"] and 0 in s["bounded_by"])
    follow(client, client.build_mesh(session, osteotomy=osteotomy["id"]))

    move = {"t": 1.0, "translation_mm": [0.0, -arguments.forward_mm, -arguments.down_mm]}
    plan = client.create_plan(session, osteotomy["id"], [{"segment": upper_jaw, "waypoints": [move]}])
    job = client.create_job(session, plan["id"], steps=arguments.steps, model=arguments.model)
    job = follow(client, job)["id"]
    for k in range(1, arguments.steps + 1):
        client.download_skin(job, k, out / ("skin_%d.glb" % k))
        client.download_skin(job, k, out / ("skin_%d.ply" % k), format="ply")
    report = client.report(job)
    (out / "report.json").write_text(json.dumps(report, indent=2))
    for name, moved in sorted(report["regions"].items()):
        print("%-16s forward %6.2f mm, down %6.2f mm" % (name, moved["forward_mm"], moved["down_mm"]))
    print("done: %s, session %s, job %s" % (out, session, job))


def follow(client, job):
    """Prints the events of a job up to its end; returns its view."""

    def show(event):
        data = event["data"]
        if event["event"] == "progress":
            print("%s: %3.0f %% %s" % (job["kind"], 100 * data["progress"], data["phase"]))
        elif event["event"] == "step":
            print("step %d of %d: %d iterations" % (data["k"], data["steps"], data["newton_iterations"]))

    return client.wait(job, show)


if __name__ == "__main__":
    main()
