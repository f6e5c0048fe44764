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


def block_vtk(cells, edge_mm):
    """Legacy VTK of a block of cubes, six tetrahedra each: its sides fixed, the middle of its bottom on segment 1."""
    n = cells + 1
    grid = list(itertools.product(range(n), repeat=3))
    number = {at: i for i, at in enumerate(grid)}
    tetrahedra = []
    for cell in itertools.product(range(cells), repeat=3):
        for order in itertools.permutations(range(3)):
            at, corners = list(cell), [number[cell]]
            for axis in order:
                at[axis] += 1
                corners.append(number[tuple(at)])
            tetrahedra.append(corners)

    def attachment(at):
        if any(c in (0, cells) for c in at[:2]):
            return 0
        return 1 if at[2] == 0 else -1

    lines = ["# vtk DataFile Version 3.0", "block", "ASCII", "DATASET UNSTRUCTURED_GRID", "POINTS %d double" % len(grid)]
    lines += [" ".join(str(edge_mm * c) for c in at) for at in grid]
    lines += ["CELLS %d %d" % (len(tetrahedra), 5 * len(tetrahedra))] + ["4 %d %d %d %d" % tuple(t) for t in tetrahedra]
    lines += ["CELL_TYPES %d" % len(tetrahedra)] + ["10"] * len(tetrahedra)
    lines += ["CELL_DATA %d" % len(tetrahedra), "SCALARS tissue int 1", "LOOKUP_TABLE default"] + ["2"] * len(tetrahedra)
    lines += ["POINT_DATA %d" % len(grid), "SCALARS attachment int 1", "LOOKUP_TABLE default"]
    return "\n".join(lines + [str(attachment(at)) for at in grid]) + "\n"


def put(client, session, part, half_mm, folder):
    path = os.path.join(folder, part + ".stl")
    with open(path, "wb") as file:
        file.write(box_stl(half_mm))
    client.put_surface(session, part, path)


def prepare(client, folder):
    session = client.create_session(label="contract")["id"]
    for part, half_mm in (("skin", 40), ("skull", 25), ("target", 41)):
        put(client, session, part, half_mm, folder)
    coarse = {"spacing_mm": 4, "envelope_spacing_mm": 2, "envelope_closing_mm": 4}
    client.put_field_settings(session, **coarse)
    client.wait(client.build_field(session))
    cut = [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 1]}}]
    osteotomy = client.create_osteotomy(session, cuts=cut)
    segment = osteotomy["segments"][-1]["id"]
    waypoints = [{"t": 1, "translation_mm": [0, -1, 0]}]
    plan = client.create_plan(session, osteotomy["id"], [{"segment": segment, "waypoints": waypoints}])
    # A ready mesh: quicker than meshing, and its job leaves every kind of result but error maps.
    other = client.create_session(label="ready mesh")["id"]
    path = os.path.join(folder, "block.vtk")
    with open(path, "w") as file:
        file.write(block_vtk(4, 10))
    client.put_surface(other, "tissue", path)
    moved = client.request("POST", "/v1/sessions/%s/plans" % other, {"paths": [{"segment": 1, "waypoints": waypoints}]})
    outputs = ["skin", "tissue"]
    job = client.wait(client.create_job(other, moved["id"], model="linear", steps=1, outputs=outputs))
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
