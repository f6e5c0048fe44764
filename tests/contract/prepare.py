"""Fills a running service with something of everything, and tells the API tester where it is.

    prepare.py URL CONFIG.toml

The main job on two boxes instead of a head; CONFIG.toml gets the ids, so that requests reach what lies behind them.
"""

import itertools
import os
import struct
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "../../api/clients/python"))
from prosopon import Client


def box_stl(half_mm):
    """Binary STL of a closed cube around the origin."""
    corners = [[half_mm if v >> axis & 1 else -half_mm for axis in range(3)] for v in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    facets = [struct.pack("<12fH", 0, 0, 0, *itertools.chain(*(corners[v] for v in t)), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(facets)


def put(client, session, part, half_mm, folder):
    path = os.path.join(folder, part + ".stl")
    with open(path, "wb") as file:
        file.write(box_stl(half_mm))
    client.put_surface(session, part, path)


def prepare(client, folder):
    session = client.create_session(label="contract")["id"]
    for part, half_mm in (("skin", 60), ("skull", 40), ("target", 61)):
        put(client, session, part, half_mm, folder)
    coarse = {"spacing_mm": 4, "envelope_spacing_mm": 2, "envelope_closing_mm": 4}
    client.put_field_settings(session, **coarse)
    client.wait(client.build_field(session))
    cut = [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 1]}}]
    osteotomy = client.create_osteotomy(session, cuts=cut)
    segment = osteotomy["segments"][-1]["id"]
    client.wait(client.build_mesh(session, osteotomy=osteotomy["id"], edge_mm=15))
    paths = [{"segment": segment, "waypoints": [{"t": 1, "translation_mm": [0, -1, 0]}]}]
    plan = client.create_plan(session, osteotomy["id"], paths)
    outputs = ["skin", "error", "tissue"]
    job = client.wait(client.create_job(session, plan["id"], model="linear", steps=1, outputs=outputs))
    return {
        "path.session": session,
        "path.osteotomy": osteotomy["id"],
        "path.plan": plan["id"],
        "path.job": job["id"],
        "path.segment": segment,
        "path.k": 1,
    }


def main():
    url, config = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        ids = prepare(Client(url), folder)
    with open(config, "w") as file:
        file.write("[parameters]\n")
        for name, value in ids.items():
            file.write('"%s" = %s\n' % (name, value if isinstance(value, int) else '"%s"' % value))
    print("prepared:", ids)


if __name__ == "__main__":
    main()
