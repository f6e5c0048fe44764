#!/usr/bin/env python3
"""Two lips in CalculiX: writes the deck, runs ccx and writes the nodes' displacements to two_lips.txt.

Usage: two_lips.py FOLDER (needs ccx 2.20 and numpy). The mesh is that of fem/tests/two_lips.rs: boxes of Kuhn tetrahedra.
"""
import itertools, subprocess, sys
import numpy as np

MU, NU = 0.011776447, 0.3
BULK = 2 * MU * (1 + NU) / (3 * (1 - 2 * NU))


def slab(cells, origin, size):
    nx, ny, nz = cells
    node = lambda i, j, k: (i * (ny + 1) + j) * (nz + 1) + k
    points = np.array([[size[0] * i / nx, size[1] * j / ny, size[2] * k / nz]
                       for i in range(nx + 1) for j in range(ny + 1) for k in range(nz + 1)]) + origin
    tets = []
    for i, j, k in itertools.product(range(nx), range(ny), range(nz)):
        for path, odd in [((0, 1, 2), 0), ((1, 2, 0), 0), ((2, 0, 1), 0), ((0, 2, 1), 1), ((2, 1, 0), 1), ((1, 0, 2), 1)]:
            at, corners = [i, j, k], [node(i, j, k)]
            for axis in path:
                at[axis] += 1
                corners.append(node(*at))
            if odd:
                corners[1], corners[2] = corners[2], corners[1]
            tets.append(corners)
    return points, np.array(tets)


def rounded(points, origin, size, by, upper):
    share = lambda a: 2 * (points[:, a] - origin[a]) / size[a] - 1
    height = (points[:, 2] - origin[2]) / size[2]
    out = by * (share(0) ** 2 + share(1) ** 2)
    points[:, 2] += out * (1 - height) if upper else -out * height


def faces(tets, wanted):
    """Faces (element, CalculiX number) of the tetrahedra whose nodes are all wanted."""
    local = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    return [(e, f + 1) for e, t in enumerate(tets) for f, c in enumerate(local) if all(wanted[t[i]] for i in c)]


def main(folder):
    lower, upper = ((8, 4, 3), np.zeros(3), (24.0, 10.0, 8.0)), ((6, 3, 3), np.array([5.0, 0.5, 8.0]), (14.0, 9.0, 8.0))
    parts = []
    for (cells, origin, size), is_upper in ((lower, False), (upper, True)):
        points, tets = slab(cells, origin, size)
        rest_z = points[:, 2].copy()
        rounded(points, origin, size, 0.6, is_upper)
        contact = np.abs(rest_z - 8.0) < 1e-9
        held = np.abs(rest_z - (16.0 if is_upper else 0.0)) < 1e-9
        parts.append((points, tets, contact, held))
    n, m = len(parts[0][0]), len(parts[0][1])
    points = np.vstack([parts[0][0], parts[1][0]])
    tets = np.vstack([parts[0][1], parts[1][1] + n])
    deck = ["*NODE, NSET=ALL"] + [f"{i + 1}, " + ", ".join(f"{c:.12g}" for c in p) for i, p in enumerate(points)]
    deck += ["*ELEMENT, TYPE=C3D4, ELSET=FAT"] + [f"{i + 1}, " + ", ".join(str(c + 1) for c in t) for i, t in enumerate(tets)]
    for name, (p, t, contact, held), offset in (("LOWER", parts[0], 0), ("UPPER", parts[1], m)):
        deck += [f"*SURFACE, NAME={name}, TYPE=ELEMENT"] + [f"{e + 1 + offset}, S{f}" for e, f in faces(t, contact)]
    for name, part, offset in (("FIXED", parts[0], 0), ("TOP", parts[1], n)):
        deck += [f"*NSET, NSET={name}"] + [f"{i + 1 + offset}," for i in np.flatnonzero(part[3])]
    deck += ["*MATERIAL, NAME=M", "*HYPERELASTIC, NEO HOOKE", f"{MU / 2:.12g}, {2 / BULK:.12g}",
             "*SOLID SECTION, ELSET=FAT, MATERIAL=M",
             "*SURFACE INTERACTION, NAME=I", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", "5.0, 1e-6",
             "*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE", "UPPER, LOWER",
             "*STEP, NLGEOM, INC=1000", "*STATIC", "0.05, 1.0, 1e-5, 0.1",
             "*BOUNDARY", "FIXED, 1, 3, 0.0", "TOP, 1, 1, 2.0", "TOP, 2, 2, 1.0", "TOP, 3, 3, -3.0",
             "*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*NODE PRINT, NSET=FIXED, TOTALS=ONLY, FREQUENCY=1000", "RF",
             "*END STEP"]
    with open(f"{folder}/two_lips.inp", "w") as file:
        file.write("\n".join(deck) + "\n")
    subprocess.run(["ccx", "two_lips"], cwd=folder, check=True, stdout=open(f"{folder}/two_lips.log", "w"))
    text = open(f"{folder}/two_lips.dat").read()
    blocks = text.split("displacements (vx,vy,vz)")
    final = blocks[-1].split("\n")[2:2 + len(points)]
    moved = [[float(c) for c in line.split()[1:]] for line in final]
    total = [line for line in text.split("\n") if line.strip()][-1].split()
    with open(f"{folder}/two_lips.txt", "w") as file:
        file.write("# CalculiX 2.20, surface to surface contact, written by two_lips.py. Displacements in 1e-6 mm, by node.\n")
        file.write("# Force on the fixed nodes, N: " + " ".join(f"{float(c):.6g}" for c in total[-3:]) + "\n")
        for u in moved:
            file.write(" ".join(str(round(1e6 * c)) for c in u) + "\n")


main(sys.argv[1])
