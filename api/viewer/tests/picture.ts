import type { Page } from "playwright-core";

/** A point of a picture as shares of its width and height, from the top left corner. */
export type Place = [number, number];

/** Difference of two colours from which they count as different: the sum over the channels, each 0 to 255. */
const DIFFERENT = 24;

/** Colours of the handles' axes. */
export type Colour = "red" | "green" | "blue";

/** Which pixel is looked for; the corner is the upper right one. */
export type Edge = "right" | "top" | "corner";

/** A decoded picture. Comparisons leave room for what software rendering does differently on each machine. */
export class Picture {
  readonly width: number;
  readonly height: number;
  /** RGBA. */
  readonly #data: Uint8Array;

  constructor(width: number, height: number, data: Uint8Array) {
    this.width = width;
    this.height = height;
    this.#data = data;
  }

  /** Share of the pixels that differ from the corner at the lower left. */
  filledShare(): number {
    const corner = this.width * (this.height - 1) + 2;
    return this.#share((i) => this.#distance(i, this, corner));
  }

  /** Share of the pixels that differ from another picture of the same size. */
  differenceTo(other: Picture): number {
    if (other.width !== this.width || other.height !== this.height) throw new Error("the two pictures have different sizes");
    return this.#share((i) => this.#distance(i, other, i));
  }

  /** Outermost pixel of a strong colour that another picture does not have there. */
  edgeOf(colour: Colour, other: Picture, edge: Edge): Place | undefined {
    const wanted = ["red", "green", "blue"].indexOf(colour);
    const isStrong = (i: number) => [0, 1, 2].every((c) => (c === wanted ? this.#at(i, c) > 170 : this.#at(i, c) < 110));
    const [right, up] = { right: [1, 0], top: [0, 1], corner: [1, 1] }[edge] as [number, number];
    let best: [number, number] | undefined;
    let farthest = -Infinity;
    for (let i = 0; i < this.width * this.height; i += 1) {
      if (!isStrong(i) || this.#distance(i, other, i) <= DIFFERENT) continue;
      const [x, y] = [i % this.width, Math.floor(i / this.width)];
      if (right * x - up * y <= farthest) continue;
      farthest = right * x - up * y;
      best = [x, y];
    }
    return best && [best[0] / this.width, best[1] / this.height];
  }

  /** Lowest row that is not background, as a share of the height. */
  lowestRow(): number {
    const corner = this.width * (this.height - 1) + 2;
    for (let i = this.width * this.height - 1; i >= 0; i -= 1) {
      if (this.#distance(i, this, corner) > DIFFERENT) return Math.floor(i / this.width) / this.height;
    }
    return 0;
  }

  /** Mean place of the pixels that differ from another picture, in rows from one share of the height to another. */
  centreOfDifference(other: Picture, [from, to] = [0, 1]): Place {
    let [x, y, count] = [0, 0, 0];
    const row = (share: number) => Math.round(share * this.height) * this.width;
    for (let i = row(from ?? 0); i < row(to ?? 1); i += 1) {
      if (this.#distance(i, other, i) <= DIFFERENT) continue;
      x += i % this.width;
      y += Math.floor(i / this.width);
      count += 1;
    }
    return [x / count / this.width, y / count / this.height];
  }

  #at(i: number, channel: number): number {
    return this.#data[4 * i + channel] ?? 0;
  }

  #share(distance: (i: number) => number): number {
    const count = this.width * this.height;
    let different = 0;
    for (let i = 0; i < count; i += 1) if (distance(i) > DIFFERENT) different += 1;
    return different / count;
  }

  #distance(i: number, other: Picture, j: number): number {
    return [0, 1, 2].reduce((sum, c) => sum + Math.abs((this.#data[4 * i + c] ?? 0) - (other.#data[4 * j + c] ?? 0)), 0);
  }
}

/** Decodes a PNG in the browser, so that the tests need no decoder. */
export async function readPicture(page: Page, png: Buffer): Promise<Picture> {
  const { width, height, base64 } = await page.evaluate(async (encoded) => {
    const bytes = Uint8Array.from(atob(encoded), (char) => char.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d") as OffscreenCanvasRenderingContext2D;
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let text = "";
    for (let i = 0; i < data.length; i += 32_768) text += String.fromCharCode(...data.subarray(i, i + 32_768));
    return { width: image.width, height: image.height, base64: btoa(text) };
  }, png.toString("base64"));
  return new Picture(width, height, Buffer.from(base64, "base64"));
}
