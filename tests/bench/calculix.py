#!/usr/bin/env python3
"""Compares CalculiX and `prosopon solve` on one slab: wall time, processor time, peak memory and their ratios.

usage: tests/bench/calculix.py PROSOPON OUT [--cells N N] [--rounds R] [--threads T]

PROSOPON is the release binary, OUT a folder for decks, meshes and results. Needs CalculiX (`apt-get install calculix-ccx`).
The slab has 150 x 150 x 16.5 mm; its uppermost 1.5 mm are skin, the rest is fat. --cells gives the cells along its sides and
through the fat; 74 and 4 (default) make 131 424 tetrahedra and 10 952 wedges. The sides and the bottom outside 60 x 60 mm
are fixed, and the patch of 41 x 41 mm in the middle of the bottom moves by (2, 0, 5) mm. All programs use linear tetrahedra
and wedges, compressible Mooney-Rivlin with Poisson ratio 0.45 and large deformations, without a locking-free formulation.
The programs run one after the other; times are of whole processes, including files, and are medians of R rounds."""
import argparse
import itertools
import json
import os
import statistics
import struct
import subprocess
import sys
import time

MOVED = (2.0, 0.0, 5.0)
POISSON = 0.45
SHEAR_MPA = {"SKIN": 0.0351, "FAT": 0.0118}
SIDE, FAT, SKIN = 150.0, 15.0, 1.5


def slab(n, depth):
    """Points, tetrahedra and wedges (lower triangle first, as in Abaqus)."""
    heights = [FAT * k / depth for k in range(depth + 1)] + [FAT + SKIN]
    at = [SIDE * (i / n - 0.5) for i in range(n + 1)]
    points = [(x, y, z) for x in at for y in at for z in heights]

    def node(i, j, k):
        return (i * (n + 1) + j) * len(heights) + k

    tetrahedra, wedges = [], []
    for i, j in itertools.product(range(n), range(n)):
        for k, path in itertools.product(range(depth), itertools.permutations(range(3))):
            place = [i, j, k]
            corners = [node(*place)]
            for axis in path:
                place[axis] += 1
                corners.append(node(*place))
            inversions = sum(path[a] > path[b] for a in range(3) for b in range(a + 1, 3))
            if inversions % 2:
                corners[1], corners[2] = corners[2], corners[1]
            tetrahedra.append(corners)
        for triangle in (((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1))):
            wedges.append([node(i + a, j + b, k) for k in (depth, depth + 1) for a, b in triangle])
    return points, tetrahedra, wedges


def attachment(point):
    """0 fixed, 1 moved, -1 free."""
    r = max(abs(point[0]), abs(point[1]))
    if r > SIDE / 2 - 1e-6:
        return 0
    if abs(point[2]) < 1e-9:
        return 1 if r <= 20.5 else 0 if r >= 30.0 else -1
    return -1


def constants(shear):
    """C10 and C01, MPa, and D1 = 2 / K, 1/MPa; C01 contributes a fifth of the shear modulus."""
    bulk = 2.0 * shear * (1.0 + POISSON) / (3.0 * (1.0 - 2.0 * POISSON))
    return 0.4 * shear, 0.1 * shear, 2.0 / bulk


def write_deck(path, mesh, held, solver):
    points, tetrahedra, wedges = mesh
    with open(path, "w") as deck:
        deck.write("*NODE,NSET=NALL\n")
        deck.writelines(f"{n},{x:.9g},{y:.9g},{z:.9g}\n" for n, (x, y, z) in enumerate(points, 1))
        first = 1
        for kind, name, cells in (("C3D4", "FAT", tetrahedra), ("C3D6", "SKIN", wedges)):
            deck.write(f"*ELEMENT,TYPE={kind},ELSET={name}\n")
            deck.writelines(f"{e},{','.join(str(v + 1) for v in c)}\n" for e, c in enumerate(cells, first))
            first += len(cells)
            law = ",".join(f"{c:.9g}" for c in constants(SHEAR_MPA[name]))
            deck.write(f"*MATERIAL,NAME=M{name}\n*HYPERELASTIC,MOONEY-RIVLIN\n{law}\n")
            deck.write(f"*SOLID SECTION,ELSET={name},MATERIAL=M{name}\n")
        deck.write(f"*STEP,NLGEOM,INC=100\n*STATIC,SOLVER={solver}\n0.2,1.\n*BOUNDARY\n")
        for n, place in enumerate(held, 1):
            if place >= 0:
                deck.writelines(f"{n},{a + 1},{a + 1},{place * MOVED[a]:.9g}\n" for a in range(3))
        deck.write("*NODE PRINT,NSET=NALL,FREQUENCY=999\nU\n*END STEP\n")


def write_vtu(path, points, cells, held, tissue):
    """A mesh for `prosopon solve`."""
    def array(kind, name, values, components=1):
        return (f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="ascii">'
                f'{" ".join(values)}</DataArray>')

    ends = itertools.accumulate(len(c) for c in cells)
    with open(path, "w") as file:
        file.write('<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
                   f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}"><Points>')
        file.write(array("Float64", "Points", (f"{c:.12g}" for p in points for c in p), 3))
        file.write("</Points><Cells>")
        file.write(array("Int64", "connectivity", (str(v) for c in cells for v in c)))
        file.write(array("Int64", "offsets", map(str, ends)))
        file.write(array("UInt8", "types", ("10" if len(c) == 4 else "13" for c in cells)))
        file.write("</Cells><PointData>")
        file.write(array("Float64", "attachment", map(str, held)))
        file.write("</PointData><CellData>")
        file.write(array("Float64", "tissue", map(str, tissue)))
        file.write("</CellData></Piece></UnstructuredGrid></VTKFile>")


def write_scene(folder, mesh, held):
    points, tetrahedra, wedges = mesh
    tissue = [2] * len(tetrahedra) + [0] * len(wedges)
    write_vtu(os.path.join(folder, "slab.vtu"), points, tetrahedra + wedges, held, tissue)

    def law(shear):
        c10, c01, _ = constants(shear)
        return {"law": "mooney_rivlin", "c10_mpa": c10, "c01_mpa": c01, "poisson": POISSON}

    scene = {"mesh": "slab.vtu", "model": "nonlinear", "skin_element": "wedge", "locking": "none",
             "materials": {"skin": law(SHEAR_MPA["SKIN"]), "fat": law(SHEAR_MPA["FAT"])},
             "segments": {"1": {"translation_mm": list(MOVED)}}, "steps": 1}
    with open(os.path.join(folder, "scene.json"), "w") as file:
        json.dump(scene, file)


def measured(command, folder, threads):
    """Wall and processor time, s, peak memory, MB, and the output of the command."""
    environment = dict(os.environ, OMP_NUM_THREADS=str(threads), RAYON_NUM_THREADS=str(threads))
    with open(os.path.join(folder, "log.txt"), "w+") as log:
        start = time.monotonic()
        child = subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        wall = time.monotonic() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        log.seek(0)
        text = log.read()
    if child.returncode != 0:
        sys.exit(f"{' '.join(command)} failed:\n{text[-2000:]}")
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss * 1.024e-3, text


def of_calculix(path):
    """Displacements of a .dat file."""
    rows = [line.split() for line in open(path)]
    return {int(r[0]): tuple(map(float, r[1:])) for r in rows if len(r) == 4 and r[0].isdigit()}


def of_prosopon(path):
    """Displacements of a VTU file with raw appended data."""
    data = open(path, "rb").read()
    head = data.index(b'Name="displacement_mm"')
    offset = int(data[data.index(b'offset="', head) + 8:].split(b'"', 1)[0])
    start = data.index(b"_", data.index(b"<AppendedData")) + 1 + offset
    length, = struct.unpack_from("<Q", data, start)
    values = struct.unpack_from(f"<{length // 8}d", data, start + 8)
    return {n + 1: values[3 * n:3 * n + 3] for n in range(len(values) // 3)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("prosopon")
    parser.add_argument("out")
    parser.add_argument("--cells", type=int, nargs=2, default=(74, 4))
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    out, prosopon = os.path.abspath(given.out), os.path.abspath(given.prosopon)
    os.makedirs(out, exist_ok=True)
    mesh = slab(*given.cells)
    held = [attachment(p) for p in mesh[0]]
    write_scene(out, mesh, held)
    decks = {"CalculiX direct": ("direct", "SPOOLES"), "CalculiX iterative": ("iterative", "ITERATIVE CHOLESKY")}
    for name, solver in decks.values():
        write_deck(os.path.join(out, f"{name}.inp"), mesh, held, solver)
    print(f"{len(mesh[1])} tetrahedra, {len(mesh[2])} wedges, {3 * held.count(-1)} unknowns, {given.threads} threads; "
          f"load before: {os.getloadavg()[0]:.1f}", flush=True)
    commands = {name: ["ccx", deck] for name, (deck, _) in decks.items()}
    commands["prosopon solve"] = [prosopon, "solve", "scene.json", "--out", "solved.vtu"]
    rows = {name: [] for name in commands}
    solve_s = []
    for _ in range(given.rounds):
        for name, command in commands.items():
            wall, cpu, peak, text = measured(command, out, given.threads)
            rows[name].append((wall, cpu, peak))
            if name == "prosopon solve":
                solve_s.append(json.loads(text.splitlines()[-1])["solve_wall_s"])
    medians = {name: [statistics.median(column) for column in zip(*found)] for name, found in rows.items()}
    own = medians["prosopon solve"]
    print(f"{'':20} {'wall s':>8} {'CPU s':>8} {'peak MB':>8}   wall, CPU relative to prosopon")
    for name, (wall, cpu, peak) in medians.items():
        print(f"{name:20} {wall:8.2f} {cpu:8.2f} {peak:8.0f}   {wall / own[0]:5.1f} {cpu / own[1]:5.1f}")
    print(f"prosopon from the loaded mesh to the solution: {statistics.median(solve_s):.2f} s of its wall time")
    ours = of_prosopon(os.path.join(out, "solved.vtu"))
    for name, (deck, _) in decks.items():
        theirs = of_calculix(os.path.join(out, f"{deck}.dat"))
        if theirs.keys() != ours.keys():
            sys.exit(f"{name} has displacements of {len(theirs)} nodes, prosopon of {len(ours)}, or of other nodes")
        apart = max(max(abs(a - b) for a, b in zip(theirs[n], ours[n])) for n in ours)
        print(f"largest difference of a displacement component from {name}: {apart:.2e} mm")


if __name__ == "__main__":
    main()
