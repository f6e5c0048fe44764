/** Skin of one step. */
export interface Frame {
  /** Coordinates x, y, z of vertex 0, 1, …, LPS mm; three times the number of vertices. */
  positions: Float32Array<ArrayBuffer>;
  /** Length of each vertex's displacement from rest, mm. */
  displacementMm: Float32Array<ArrayBuffer>;
  /** Signed distance to the reference, mm, negative behind it; absent without an error map. */
  errorMm?: Float32Array<ArrayBuffer>;
}

const SCALARS = ["displacement_mm", "error_mm"];

/**
 * Decodes the answer of `GET /v1/jobs/{job}/steps/{k}/frame`.
 *
 * @param bytes body of the answer
 * @param vertices number of vertices of the job's skin
 * @throws Error when the length is not that of a frame with this number of vertices
 */
export function decodeFrame(bytes: ArrayBuffer, vertices: number): Frame {
  const scalars = bytes.byteLength / (4 * vertices) - 3;
  if (!Number.isInteger(scalars) || scalars < 1 || scalars > SCALARS.length) {
    throw new Error(`a frame of ${vertices} vertices has ${16 * vertices} or ${20 * vertices} bytes, found ${bytes.byteLength}`);
  }
  const values = littleEndian(bytes, (view, at) => view.getFloat32(at, true), Float32Array);
  const positions = values.subarray(0, 3 * vertices);
  const displacementMm = values.subarray(3 * vertices, 4 * vertices);
  return scalars === 1 ? { positions, displacementMm } : { positions, displacementMm, errorMm: values.subarray(4 * vertices) };
}

/** Decodes the answer of `GET /v1/jobs/{job}/topology`: three vertex numbers for each triangle, counter-clockwise from outside. */
export function decodeTopology(bytes: ArrayBuffer): Uint32Array<ArrayBuffer> {
  if (bytes.byteLength % 12 !== 0) throw new Error(`a topology has 12 bytes for each triangle, found ${bytes.byteLength} bytes`);
  return littleEndian(bytes, (view, at) => view.getUint32(at, true), Uint32Array);
}

const HOST_IS_LITTLE_ENDIAN = new Uint8Array(Uint16Array.of(1).buffer)[0] === 1;

interface NumberArray<A> {
  new (buffer: ArrayBuffer): A;
  from(source: { length: number }, map: (value: unknown, index: number) => number): A;
}

function littleEndian<A>(bytes: ArrayBuffer, get: (view: DataView, at: number) => number, kind: NumberArray<A>): A {
  if (HOST_IS_LITTLE_ENDIAN) return new kind(bytes);
  const view = new DataView(bytes);
  return kind.from({ length: bytes.byteLength / 4 }, (_, index) => get(view, 4 * index));
}
