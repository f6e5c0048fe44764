#!/usr/bin/env python3
"""Makes a CT of clinical size from a coarse one, for measurements: interpolates voxels linearly and adds noise.

Without noise the file would compress far better than a clinical one.

    enlarge_ct.py CT.nii.gz OUT.nii.gz [--times 2 2 3] [--noise-hu 20]

Reads NIfTI-1 of 16 bits, little endian. Needs numpy.
"""

import argparse
import gzip
import struct

import numpy

HEADER = 352


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ct")
    parser.add_argument("out")
    parser.add_argument("--times", type=int, nargs=3, default=[2, 2, 3])
    parser.add_argument("--noise-hu", type=float, default=20.0)
    arguments = parser.parse_args()
    data = gzip.open(arguments.ct).read()
    header = bytearray(data[:HEADER])
    size, spacing = struct.unpack_from("<3h", header, 42), struct.unpack_from("<3f", header, 80)
    if struct.unpack_from("<h", header, 70) != (4,) or struct.unpack_from("<f", header, 108) != (HEADER,):
        parser.error("expected 16 bits at offset %d" % HEADER)
    voxels = numpy.frombuffer(data, "<i2", offset=HEADER).reshape(size[::-1]).astype(numpy.float32)
    for axis, times in enumerate(reversed(arguments.times)):
        voxels = finer(voxels, axis, times)
    slope = struct.unpack_from("<f", header, 112)[0] or 1.0
    voxels += numpy.random.default_rng(1).normal(0.0, arguments.noise_hu / slope, voxels.shape).astype(numpy.float32)
    voxels = voxels.round().clip(-32768, 32767).astype("<i2")
    struct.pack_into("<3h", header, 42, *reversed(voxels.shape))
    struct.pack_into("<3f", header, 80, *(s / t for s, t in zip(spacing, arguments.times)))
    for row in (280, 296, 312):
        columns = struct.unpack_from("<3f", header, row)
        struct.pack_into("<3f", header, row, *(c / t for c, t in zip(columns, arguments.times)))
    with gzip.open(arguments.out, "wb", compresslevel=6) as file:
        file.write(header)
        file.write(voxels.tobytes())
    print("%d x %d x %d voxels" % tuple(reversed(voxels.shape)))


def finer(voxels, axis, times):
    """Inserts `times` - 1 interpolated voxels between neighbours along an axis."""
    first = numpy.take(voxels, range(voxels.shape[axis] - 1), axis)
    step = (numpy.take(voxels, range(1, voxels.shape[axis]), axis) - first) / times
    pieces = numpy.stack([first + step * k for k in range(times)], axis + 1)
    shape = list(voxels.shape)
    shape[axis] = first.shape[axis] * times
    return pieces.reshape(shape)


if __name__ == "__main__":
    main()
