// The panel's pixels as tiles, row by row, because browsers refuse large single pictures.

class PanelTiles {
  // All bitmaps have the size of the first bitmap; bitmaps of the last column and row may be smaller.
  constructor(bitmaps, width, height) {
    Object.assign(this, { bitmaps, width, height });
    this.tile = [bitmaps[0].width, bitmaps[0].height];
    this.across = Math.ceil(width / this.tile[0]);
  }

  // Calls `use` with each bitmap, the bitmap's top left pixel and the bitmap's index.
  forEach(use) {
    const [width, height] = this.tile;
    this.bitmaps.forEach((bitmap, k) => use(bitmap, (k % this.across) * width, Math.floor(k / this.across) * height, k));
  }
}

// Decodes base64. `fetch` of a data: URL takes a second for 20 MB. New browsers have `fromBase64`.
function bytesFrom(text) {
  return Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

// Decodes the frames of the page's panel, and removes their base64 texts to free memory.
async function framesOfPage({ width_px, height_px }) {
  const frames = [];
  for (const text of document.querySelectorAll(".panel-tile")) {
    const blob = new Blob([bytesFrom(text.textContent)], { type: "image/png" });
    const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
    (frames[Number(text.dataset.frame)] ??= []).push(bitmap);
    text.remove();
  }
  return frames.map((bitmaps) => new PanelTiles(bitmaps, width_px, height_px));
}
