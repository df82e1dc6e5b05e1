// The panel's pixels as pictures side by side, row by row: browsers refuse large single ones.

class PanelTiles {
  // All bitmaps have the first one's size; those of the last column and row may be smaller.
  constructor(bitmaps, width, height) {
    Object.assign(this, { bitmaps, width, height });
    this.tile = [bitmaps[0].width, bitmaps[0].height];
    this.across = Math.ceil(width / this.tile[0]);
  }

  // Calls `use` with each bitmap, its top left pixel and its number.
  forEach(use) {
    const [width, height] = this.tile;
    this.bitmaps.forEach((bitmap, k) => use(bitmap, (k % this.across) * width, Math.floor(k / this.across) * height, k));
  }
}

// Of base64. `fetch` of a data: URL takes a second for 20 MB, and younger browsers have this built in.
function bytesFrom(text) {
  return Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

// Decodes the page's panel, a film's frame by frame, and removes its texts, which take more memory than the page needs.
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
