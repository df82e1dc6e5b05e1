// Shows the panel and its elemental images, with zoom, pan, the lenslets' borders, and rings where the eye looks.

const SEAMS_FROM_PX = 8; // minimum width of a cell on the screen that shows borders
const MOST_ZOOM = 64; // maximum number of screen pixels per panel pixel

class PanelView {
  constructor(canvas, panel, onChange) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.panel = panel;
    this.onChange = onChange;
    this.centre = [panel.width / 2, panel.height / 2];
    this.zoom = 0; // screen pixels for a panel pixel; 0 fits the whole panel
    this.pointers = new Map();
    this.lensletsDrawn = false;
    this.listen();
  }

  get fit() {
    return Math.min(this.canvas.width / this.panel.width, this.canvas.height / this.panel.height);
  }

  get scale() {
    return Math.max(this.zoom, this.fit);
  }

  pixelAt([x, y]) {
    return [
      this.centre[0] + (x - this.canvas.width / 2) / this.scale,
      this.centre[1] + (y - this.canvas.height / 2) / this.scale,
    ];
  }

  // Zooms by a factor. The panel pixel at the point `at` of the canvas stays at that point.
  zoomBy(factor, at = [this.canvas.width / 2, this.canvas.height / 2]) {
    const before = this.pixelAt(at);
    this.zoom = Math.min(this.scale * factor, MOST_ZOOM);
    const after = this.pixelAt(at);
    this.panBy(before[0] - after[0], before[1] - after[1]);
  }

  panBy(columns, rows) {
    const clamp = (value, size, half) => (half * 2 >= size ? size / 2 : Math.min(Math.max(value, half), size - half));
    this.centre = [
      clamp(this.centre[0] + columns, this.panel.width, this.canvas.width / 2 / this.scale),
      clamp(this.centre[1] + rows, this.panel.height, this.canvas.height / 2 / this.scale),
    ];
    this.onChange();
  }

  showAll() {
    this.zoom = 0;
    this.panBy(0, 0);
  }

  // Fills the canvas with about three lenslets around the middle of the visible part.
  showLenslets(system) {
    this.zoom = Math.min((Math.min(this.canvas.width, this.canvas.height) * Math.min(...system.pixelPitch)) / (3 * Math.max(...system.pitch)), MOST_ZOOM);
    this.panBy(0, 0);
  }

  listen() {
    const canvas = this.canvas;
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [
        ((event.clientX - box.left) * canvas.width) / box.width,
        ((event.clientY - box.top) * canvas.height) / box.height,
      ];
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(2 ** (-event.deltaY / 200), place(event));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, place(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      const now = place(event);
      const before = this.pointers.get(event.pointerId);
      if (before) this.drag(event.pointerId, before, now);
      this.hover = now;
      this.onChange();
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("pointerleave", () => {
      this.hover = undefined;
      this.onChange();
    });
    canvas.addEventListener("keydown", (event) => {
      const far = 40 / this.scale;
      const moves = { ArrowLeft: [-far, 0], ArrowRight: [far, 0], ArrowUp: [0, -far], ArrowDown: [0, far] };
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (moves[event.key]) this.panBy(...moves[event.key]);
      else if (event.key === "+" || event.key === "=") this.zoomBy(1.5);
      else if (event.key === "-") this.zoomBy(1 / 1.5);
      else if (event.key === "0" || event.key === "Home") this.showAll();
      else return;
      event.preventDefault();
    });
  }

  // One finger or the mouse pans. Two fingers also zoom.
  drag(id, before, now) {
    const others = [...this.pointers].filter(([other]) => other !== id).map(([, at]) => at);
    this.pointers.set(id, now);
    if (others.length) {
      const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
      this.zoomBy(apart(now, others[0]) / Math.max(apart(before, others[0]), 1), others[0]);
    } else {
      this.panBy((before[0] - now[0]) / this.scale, (before[1] - now[1]) / this.scale);
    }
  }

  showsLenslets(system) {
    return (Math.min(...system.pitch) / Math.max(...system.pixelPitch)) * this.scale >= SEAMS_FROM_PX;
  }

  draw(system, eye, { seams, marks }) {
    const { context, canvas, panel, scale } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.imageSmoothingEnabled = scale < 1;
    context.imageSmoothingQuality = "high"; // a panel is full of detail: skipped pixels would cause moire stripes
    const [left, top] = this.pixelAt([0, 0]);
    panel.forEach((bitmap, x, y) => {
      // Edges lie on whole screen pixels, because the background would shine through partly covered pixels.
      const edges = [x - left, y - top, x - left + bitmap.width, y - top + bitmap.height];
      const [x0, y0, x1, y1] = edges.map((edge) => Math.round(edge * scale));
      const visible = x1 > 0 && y1 > 0 && x0 < canvas.width && y0 < canvas.height;
      if (visible) context.drawImage(bitmap, x0, y0, x1 - x0, y1 - y0);
    });
    context.setTransform(scale, 0, 0, scale, -left * scale, -top * scale);
    this.lensletsDrawn = this.showsLenslets(system);
    if (!this.lensletsDrawn) return;
    const cells = this.visibleCells(system);
    if (seams) this.drawSeams(system, cells);
    if (marks) this.drawMarks(system, cells, eye);
  }

  visibleCells(system) {
    const corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(([x, y]) => {
      const pixel = this.pixelAt([x * this.canvas.width, y * this.canvas.height]);
      return owner(system, arrayFromPanel(system, panelFromPixel(system, pixel)));
    });
    const range = (k) => [Math.min(...corners.map((c) => c[k])) - 1, Math.max(...corners.map((c) => c[k])) + 1];
    const [[i0, i1], [j0, j1]] = [range(0), range(1)];
    const cells = [];
    for (let j = j0; j <= j1; ++j) for (let i = i0; i <= i1; ++i) cells.push(centreOf(system, i, j));
    return cells.filter((cell) => present(system, cell));
  }

  drawSeams(system, cells) {
    const context = this.context;
    const corners = cellCorners(system);
    context.beginPath();
    for (const [cx, cy] of cells) {
      corners.forEach(([x, y], k) => {
        const [u, v] = pixelFromPanel(system, panelFromArray(system, behind(system, [cx + x, cy + y])));
        if (k) context.lineTo(u, v);
        else context.moveTo(u, v);
      });
      context.closePath();
    }
    this.stroke("rgb(0 0 0 / 60%)", 3);
    this.stroke("rgb(255 255 255 / 80%)", 1);
  }

  stroke(colour, pixels) {
    this.context.lineWidth = pixels / this.scale;
    this.context.strokeStyle = colour;
    this.context.stroke();
  }

  // Draws a ring around the point of the panel on the line from the eye through each lenslet's centre.
  drawMarks(system, cells, eye) {
    const context = this.context;
    const radius = Math.max(0.7, 3 / this.scale);
    const reach = system.apertureDistance / eye.position[2];
    context.beginPath();
    for (const cell of cells) {
      const [x, y] = panelFromArray(system, cell);
      const landing = [x - reach * (eye.position[0] - x), y - reach * (eye.position[1] - y)];
      const [u, v] = pixelFromPanel(system, landing);
      context.moveTo(u + radius, v);
      context.arc(u, v, radius, 0, 2 * Math.PI);
    }
    this.stroke("rgb(0 0 0 / 80%)", 4);
    this.stroke("rgb(255 220 0)", 2);
  }
}
