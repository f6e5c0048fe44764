#!/usr/bin/env python3
"""Operations on both jaws and both rami of real heads, from raw CTs and proposed landmarks.

    both_jaws.py PROSOPON OUT CT [CT ...] [--patients a b c] [--steps 6] [--edge-mm 4] [--model mixed] [--two-surfaces]

Starts the service on a free port of this machine. For each CT and the motions of each patient it cuts (Le Fort I, both
sagittal splits), plans, solves and follows the events of the job. Prints the outcome and the warnings of each solve, and the
largest factor by which `eta_s` was wrong after 20 % of the job. With --two-surfaces the bone is first separated into skull
and mandible and uploaded again as two surfaces in one file. Writes `cases.csv`, and for each case the progress events and a
picture, to OUT. The pictures show faces: keep OUT private. """

import argparse
import csv
import json
import pathlib
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from raw_ct import Client, Service, tell  # noqa: E402

# Motions of real patients (LPS, mm and degrees): maxilla, distal mandible, turns of left and right ramus about their condyles.
PATIENTS = {
    "a": (([-0.1, -2.4, 0.7], 1.9), ([-3.9, 4.3, 3.4], 3.4), [8.2, 2.1]),
    "b": (([0.5, -4.1, 1.4], 3.5), ([0.0, 4.1, 7.5], 1.3), [3.7, 7.7]),
    "c": (([0.8, -1.1, 0.5], 1.9), ([2.8, 4.7, 2.7], 2.3), [3.3, 4.8]),
}
# Only the total angles of the jaws are known; this axis is assumed for both. A ramus turns upward and inward to meet the jaw.
JAW_AXIS = [0.8, 0.2, 0.5]
RAMUS_AXES = {"left": [1.0, 0.0, 0.7], "right": [1.0, 0.0, -0.7]}
# The estimate of the remaining time is judged from this share of the job on, and until this time before the end, s.
JUDGED_FROM = 0.2
JUDGED_UNTIL_S = 3.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("prosopon")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("ct", type=pathlib.Path, nargs="+")
    parser.add_argument("--patients", nargs="*", choices=sorted(PATIENTS), default=sorted(PATIENTS))
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--edge-mm", type=float, default=4.0)
    parser.add_argument("--model", default="mixed")
    parser.add_argument("--two-surfaces", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as data, open(arguments.out / "service.log", "w") as log:
        service = Service(arguments.prosopon, pathlib.Path(data), log)
        try:
            client = Client(service.start())
            for ct in arguments.ct:
                rows += head(client, arguments, ct)
        finally:
            service.stop()
    with open(arguments.out / "cases.csv", "w", newline="") as file:
        csv.writer(file).writerows([("head", "patient", "status", "outcome", "wall_s", "eta_factor", "warnings")] + rows)
    if any(row[2] != "succeeded" for row in rows):
        sys.exit("both_jaws: a solve did not succeed; see cases.csv")


def head(client, arguments, ct):
    name = ct.name.split(".")[0]
    session = client.create_session(label="both_jaws.py " + name)["id"]
    print("%s: import" % name, flush=True)
    tell(client.wait(client.put_ct(session, str(ct))))
    landmarks = client.request("GET", "/v1/sessions/%s/landmarks?propose=true" % session)
    client.put_landmarks(session, landmarks)
    if arguments.two_surfaces:
        two_surfaces(client, arguments, session)
    tell(client.wait(client.build_field(session)))
    try:
        body = {"templates": [{"name": t} for t in ("le_fort_1", "bsso_left", "bsso_right")]}
        cut = client.request("POST", "/v1/sessions/%s/osteotomies" % session, body)
    except Exception as error:  # noqa: BLE001
        print("%s: the cut was refused: %s" % (name, error), flush=True)
        return [(name, patient, "refused", str(error), "", "", "") for patient in arguments.patients]
    for segment in cut["segments"]:
        print("   segment %d %s: %.1f cm3" % (segment["id"], segment["name"], segment["volume_mm3"] / 1000))
    tell(cut)
    tell(client.wait(client.build_mesh(session, osteotomy=cut["id"], edge_mm=arguments.edge_mm)))
    return [solve(client, arguments, (name, session, patient), cut, landmarks["points"]) for patient in arguments.patients]


def two_surfaces(client, arguments, session):
    """Replaces the bone by two separate surfaces, the skull and the lower jaw."""
    client.wait(client.build_field(session))
    cut = client.request("POST", "/v1/sessions/%s/osteotomies" % session, {"templates": [{"name": "mandible"}]})
    tell(cut)
    merged = arguments.out / "two_surfaces.stl"
    triangles = b""
    for segment in cut["segments"]:
        part = arguments.out / "part.stl"
        client.download("/v1/sessions/%s/osteotomies/%s/segments/%d?format=stl" % (session, cut["id"], segment["id"]), part)
        triangles += part.read_bytes()[84:]
    merged.write_bytes(bytes(80) + (len(triangles) // 50).to_bytes(4, "little") + triangles)
    tell(client.put_surface(session, "skull", str(merged)))


def solve(client, arguments, case, cut, points):
    name, session, patient = case
    upper, lower, rami = PATIENTS[patient]
    ids = {s["name"]: s["id"] for s in cut["segments"]}

    def path(segment, shift, axis, degrees, pivot=None):
        turn = {"axis": axis, "angle_deg": degrees}
        waypoint = {"t": 1.0, "translation_mm": shift, "rotation": {"axis_angle": turn}}
        if pivot:
            waypoint["rotation"]["pivot_mm"] = pivot
        return {"segment": ids[segment], "waypoints": [waypoint]}

    paths = [path("maxilla", upper[0], JAW_AXIS, upper[1]), path("mandible_distal", lower[0], JAW_AXIS, lower[1])]
    for side, degrees in zip(("left", "right"), rami):
        condyle = points.get("condylion_" + side)
        if condyle and "mandible_proximal_" + side in ids:
            paths.append(path("mandible_proximal_" + side, [0.0, 0.0, 0.0], RAMUS_AXES[side], degrees, condyle))
        else:
            print("   the %s ramus does not move: %s" % (side, "no separate segment" if condyle else "no condyle was proposed"))
    plan = client.create_plan(session, cut["id"], paths)
    tell(plan)
    job = client.create_job(session, plan["id"], steps=arguments.steps, model=arguments.model)
    begun, events = time.monotonic(), []
    for event in client.events(job["id"]):
        if event["event"] == "progress":
            data = event["data"] if isinstance(event["data"], dict) else json.loads(event["data"])
            events.append((time.monotonic() - begun, data["phase"], data["progress"], data.get("eta_s")))
    wall = time.monotonic() - begun
    view = client.job(job["id"])
    judged = [(wall - at, eta) for at, _, progress, eta in events
              if eta is not None and progress >= JUDGED_FROM and wall - at > JUDGED_UNTIL_S]
    factor = max((max(eta / left, left / max(eta, 1e-9)) for left, eta in judged), default=1.0)
    label = "%s_%s" % (name, patient)
    (arguments.out / (label + "_events.json")).write_text(json.dumps(events))
    warnings = [w["message"] for w in view.get("warnings", [])]
    outcome = ""
    if view["status"] == "succeeded":
        outcome = client.report(job["id"])["steps"][-1].get("outcome", "")
        client.download("/v1/jobs/%s/steps/%d/picture.png" % (job["id"], arguments.steps), arguments.out / (label + ".png"))
    elif view.get("problem"):
        outcome = view["problem"].get("detail", "")
    print("%s, patient %s: %s %s in %.1f s, eta wrong by %.1f at most" % (name, patient, view["status"], outcome, wall, factor))
    for warning in warnings:
        print("   " + warning)
    sys.stdout.flush()
    return (name, patient, view["status"], outcome, round(wall, 1), round(factor, 2), " | ".join(warnings))


if __name__ == "__main__":
    main()
