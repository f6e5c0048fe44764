#!/usr/bin/env python3
"""Error of plain and patched elements on a head, against CalculiX with quadratic elements.

usage: tests/bench/calculix_head.py PROSOPON OUT [--head DIR] [--edges MM ...] [--reference MM ...]

PROSOPON is the release binary, OUT a folder for meshes, decks and results. Needs CalculiX (`apt-get install calculix-ccx`),
numpy and scipy. The scene is the demo's Le Fort I, 6 mm forward and 1.5 mm down, on the generated head or on DIR
(`DIR.nii.gz` or skin and skull), without contact: tissue that is tied to bone or glides on it is tied here, all other tissue is free. Poisson ratio
0.45, neo-Hookean. The service makes the meshes. Of each --edges mesh `prosopon solve` computes the skin with linear elements;
of each --reference mesh CalculiX computes it with quadratic tetrahedra and wedges (C3D10, C3D15) on straight edges. The last
reference counts. An error is the distance between two solutions at the reference's nodes of the skin that move by more than
0.1 mm; the other references show how far the last one may itself be off."""
import argparse
import collections
import itertools
import json
import os
import re
import struct
import subprocess
import sys
import time
import urllib.request

import numpy
from scipy.spatial import cKDTree

import calculix

POISSON = 0.45
# Small-strain shear moduli of the published constants, MPa, by the number of the tissue in a VTU file.
TISSUES = {0: ("SKIN", 0.070142923), 1: ("MUSCLE", 0.041229888), 2: ("FAT", 0.011776447), 3: ("MUCOSA", 0.041229888)}
SIDES = {4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
         6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))}
FACES = {4: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
         6: ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 2, 5, 3))}

Mesh = collections.namedtuple("Mesh", "points cells tissue held")


def call(url, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"content-type": "application/json"} if data else {})
    with urllib.request.urlopen(request) as answer:
        return answer.read()


def finished(url, path, body):
    """Sends a request that begins a job, and waits for its end."""
    job = json.loads(call(url + path, body))
    while job["status"] in ("accepted", "running"):
        job = json.loads(call(f"{url}/v1/jobs/{job['id']}?wait_s=30"))
    if job["status"] != "succeeded":
        sys.exit(f"{path} {body}: {job['problem']}")
    return job["id"]


def arrays(path):
    """Arrays of a VTU file with raw appended data, by name."""
    data = open(path, "rb").read()
    start = data.index(b"_", data.index(b"<AppendedData")) + 1
    kinds = {"Float64": "<f8", "Float32": "<f4", "Int64": "<i8", "UInt32": "<u4", "UInt8": "<u1", "Int32": "<i4"}
    found = {}
    for tag in re.findall(rb"<DataArray [^>]*>", data[:start]):
        part = dict(re.findall(r'(\w+)="([^"]*)"', tag.decode()))
        at = start + int(part["offset"])
        length, = struct.unpack_from("<Q", data, at)
        found[part.get("Name", "Points")] = numpy.frombuffer(data, kinds[part["type"]], length // numpy.dtype(kinds[part["type"]]).itemsize, at + 8)
    return found


def mesh_of(path):
    """The mesh at rest, from a solved one."""
    found = arrays(path)
    points = found["Points"].reshape(-1, 3) - found["displacement_mm"].reshape(-1, 3)
    cells = [tuple(int(v) for v in c) for c in numpy.split(found["connectivity"], found["offsets"][:-1])]
    # What glides on a segment (-3 - segment) is tied to it here; what slides is free.
    held = [int(a) if a >= 0 else int(-3 - a) if a <= -3 else -1 for a in found["attachment"]]
    return Mesh(points, cells, [int(t) for t in found["tissue"]], held)


def upright(mesh):
    """Cells with positive volume in the order of Abaqus."""
    def turned(cell):
        a, b, c, d = (mesh.points[v] for v in cell[:4])
        if numpy.dot(numpy.cross(b - a, c - a), d - a) > 0:
            return cell
        return (cell[1], cell[0]) + cell[2:] if len(cell) == 4 else cell[1::-1] + cell[2:3] + cell[4:2:-1] + cell[5:]
    return [turned(c) for c in mesh.cells]


def write_scene(path, mesh, moved, locking):
    """A scene for `prosopon solve`."""
    name = os.path.basename(path)
    calculix.write_vtu(path + ".vtu", mesh.points.tolist(), mesh.cells, mesh.held, mesh.tissue)
    # CalculiX's neo-Hookean energy: that of Mooney and Rivlin without the second constant.
    laws = {name.lower(): {"law": "mooney_rivlin", "c10_mpa": shear / 2, "c01_mpa": 0.0, "poisson": POISSON}
            for name, shear in TISSUES.values()}
    scene = {"mesh": name + ".vtu", "model": "nonlinear", "skin_element": "wedge", "locking": locking, "materials": laws,
             "segments": {str(s): {"translation_mm": t} for s, t in moved.items()}, "steps": 1}
    with open(f"{path}-{locking}.json", "w") as file:
        json.dump(scene, file)


def write_deck(path, mesh, moved):
    """A deck of quadratic elements; the middle of an edge is held where a whole face of the border is."""
    cells = upright(mesh)
    faces = collections.Counter(frozenset(c[v] for v in f) for c in cells for f in FACES[len(c)])
    border = (f for f, count in faces.items() if count == 1)
    held_faces = [f for f in border if len({mesh.held[v] for v in f}) == 1 and mesh.held[next(iter(f))] >= 0]
    held_edges = {frozenset(e) for f in held_faces for e in itertools.combinations(f, 2)}
    points, held, middles = list(map(tuple, mesh.points)), list(mesh.held), {}

    def middle(edge):
        if edge not in middles:
            middles[edge] = len(points)
            a, b = edge
            points.append(tuple((mesh.points[a] + mesh.points[b]) / 2))
            held.append(mesh.held[a] if edge in held_edges else -1)
        return middles[edge]

    quadratic = [c + tuple(middle(frozenset((c[a], c[b]))) for a, b in SIDES[len(c)]) for c in cells]
    with open(path, "w") as deck:
        deck.write("*NODE,NSET=NALL\n")
        deck.writelines(f"{n},{x:.12g},{y:.12g},{z:.12g}\n" for n, (x, y, z) in enumerate(points, 1))
        for (tissue, size), own in itertools.groupby(
                sorted(range(len(cells)), key=lambda n: (mesh.tissue[n], len(cells[n]))),
                key=lambda n: (mesh.tissue[n], len(cells[n]))):
            name, shear = TISSUES[tissue]
            bulk = 2.0 * shear * (1.0 + POISSON) / (3.0 * (1.0 - 2.0 * POISSON))
            deck.write(f"*ELEMENT,TYPE={'C3D10' if size == 4 else 'C3D15'},ELSET={name}{size}\n")
            for n in own:
                nodes = [str(v + 1) for v in quadratic[n]]
                deck.write(f"{n + 1},{','.join(nodes[:10])}{',' if size == 6 else ''}\n")
                if size == 6:
                    deck.write(",".join(nodes[10:]) + "\n")
            deck.write(f"*MATERIAL,NAME=M{name}{size}\n*HYPERELASTIC,NEO HOOKE\n{shear / 2:.12g},{2.0 / bulk:.12g}\n"
                       f"*SOLID SECTION,ELSET={name}{size},MATERIAL=M{name}{size}\n")
        deck.write("*STEP,NLGEOM,INC=100\n*STATIC,SOLVER=ITERATIVE CHOLESKY\n0.34,1.\n*BOUNDARY\n")
        for n, segment in enumerate(held, 1):
            if segment >= 0:
                motion = moved.get(segment, (0.0, 0.0, 0.0))
                deck.writelines(f"{n},{a + 1},{a + 1},{motion[a]:.12g}\n" for a in range(3))
        deck.write("*NODE PRINT,NSET=NALL,FREQUENCY=999\nU\n*END STEP\n")
    return 3 * held.count(-1)


def skin_of(mesh):
    """Triangles of the outer side of the skin."""
    inner = {v for c in mesh.cells if len(c) == 4 for v in c}
    sides = (side for c in mesh.cells if len(c) == 6 for side in (c[:3], c[3:]))
    return numpy.array([side for side in sides if not inner.issuperset(side)])


def at_points(mesh, moved, places):
    """Displacement of the skin at `places`, from the nearest point of its triangles."""
    triangles = skin_of(mesh)
    corners = mesh.points[triangles]
    _, near = cKDTree(corners.mean(axis=1)).query(places, 12)
    best, value = numpy.full(len(places), numpy.inf), numpy.zeros((len(places), 3))
    for of in near.T:
        a, b, c = (corners[of, k] for k in range(3))
        e, f, g = b - a, c - a, places - a
        ee, ef, ff, eg, fg = ((x * y).sum(1) for x, y in ((e, e), (e, f), (f, f), (e, g), (f, g)))
        area = ee * ff - ef * ef
        s, t = (ff * eg - ef * fg) / area, (ee * fg - ef * eg) / area
        # Outside the triangle the clamped weights give a point of it that is near enough: its neighbour is the nearer one.
        weights = numpy.clip(numpy.stack([1 - s - t, s, t]), 0, 1)
        weights /= weights.sum(0)
        foot = (weights[:, :, None] * corners[of].transpose(1, 0, 2)).sum(0)
        distance = numpy.linalg.norm(foot - places, axis=1)
        u = (weights[:, :, None] * moved[triangles[of]].transpose(1, 0, 2)).sum(0)
        nearer = distance < best
        best[nearer], value[nearer] = distance[nearer], u[nearer]
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("prosopon")
    parser.add_argument("out")
    parser.add_argument("--head")
    parser.add_argument("--edges", type=float, nargs="+", default=[7.0, 5.5, 4.5, 3.7])
    parser.add_argument("--reference", type=float, nargs="+", default=[5.5, 4.5])
    given = parser.parse_args()
    out, prosopon = os.path.abspath(given.out), os.path.abspath(given.prosopon)
    os.makedirs(out, exist_ok=True)
    meshes, moved = prepared(prosopon, out, given.head, sorted({*given.edges, *given.reference}))

    references = {}
    for edge in given.reference:
        unknowns = write_deck(os.path.join(out, f"quadratic-{edge}.inp"), meshes[edge], moved)
        wall, _, peak, _ = calculix.measured(["ccx", f"quadratic-{edge}"], out, 2)
        found = calculix.of_calculix(os.path.join(out, f"quadratic-{edge}.dat"))
        references[edge] = numpy.array([found[n + 1] for n in range(len(meshes[edge].points))])
        print(f"CalculiX, quadratic, {edge} mm: {unknowns} unknowns, {wall:.0f} s, {peak:.0f} MB", flush=True)
    last = given.reference[-1]
    nodes = numpy.unique(skin_of(meshes[last]))
    places, truth = meshes[last].points[nodes], references[last][nodes]

    def row(name, mesh, displacement, seconds=""):
        found = at_points(mesh, displacement, places)
        counts = numpy.maximum(numpy.linalg.norm(found, axis=1), numpy.linalg.norm(truth, axis=1)) > 0.1
        error = numpy.linalg.norm(found - truth, axis=1)[counts]
        print(f"{name:24} mean {error.mean():.3f} P95 {numpy.percentile(error, 95):.3f} largest {error.max():.3f} mm {seconds}",
              flush=True)

    for edge in given.reference[:-1]:
        row(f"quadratic {edge}", meshes[edge], references[edge])
    for edge, locking in itertools.product(given.edges, ("none", "patched")):
        path = os.path.join(out, f"linear-{edge}")
        write_scene(path, meshes[edge], moved, locking)
        wall, _, _, _ = calculix.measured([prosopon, "solve", f"{path}-{locking}.json", "--out", f"{path}-{locking}-solved.vtu"], out, 2)
        row(f"{locking} {edge}", meshes[edge],
            arrays(f"{path}-{locking}-solved.vtu")["displacement_mm"].reshape(-1, 3), f"{wall:.1f} s")


def prepared(prosopon, out, head, edges):
    """The meshes by edge, and the translation of each segment, from the service."""
    command = [prosopon, "demo", "--keep", "--no-compare", "--model", "linear", "--steps", "1", "--out", os.path.join(out, "demo")]
    if head:
        command += ["--ct", head]
    log = open(os.path.join(out, "demo.log"), "w+")
    service = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        while "the service keeps running" not in (text := open(log.name).read()):
            if service.poll() is not None:
                sys.exit(text)
            time.sleep(1)
        url = re.search(r"http://[\d.:]+", text).group()
        session = "/v1/sessions/" + json.loads(call(url + "/v1/sessions"))["sessions"][0]["id"]
        plan = json.loads(call(f"{url}{session}/plans"))["plans"][0]
        moved = {path["segment"]: path["waypoints"][-1]["translation_mm"] for path in plan["paths"]}
        meshes = {}
        for edge in edges:
            mesh = finished(url, f"{session}/mesh", {"osteotomy": plan["osteotomy"], "edge_mm": edge})
            solve = {"plan": plan["id"], "mesh": mesh, "model": "linear", "steps": 1, "outputs": ["tissue"], "leave_out_below_mm": 0}
            path = os.path.join(out, f"mesh-{edge}.vtu")
            with open(path, "wb") as file:
                file.write(call(f"{url}/v1/jobs/{finished(url, f'{session}/jobs', solve)}/tissue"))
            meshes[edge] = mesh_of(path)
            kinds = collections.Counter(map(len, meshes[edge].cells))
            print(f"mesh of {edge} mm: {kinds[4]} tetrahedra, {kinds[6]} prisms", flush=True)
        return meshes, moved
    finally:
        service.terminate()
        service.wait()


if __name__ == "__main__":
    main()
