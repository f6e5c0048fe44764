import { DoubleSide, FrontSide } from "three";
import type { Material } from "three";

/** Sets the opacity of a material. Of a transparent surface only the front is drawn, so that one layer covers what lies behind. */
export function setOpacity(material: Material, opacity: number): void {
  const transparent = opacity < 1;
  material.opacity = opacity;
  if (material.transparent === transparent) return;
  material.transparent = transparent;
  material.side = transparent ? FrontSide : DoubleSide;
  // The shader of an opaque material ignores the opacity.
  material.needsUpdate = true;
}
