// Finds the lenslet of a point and the centres of lenslets, as optics/lattice.py, optics/system.py and optics/panel.py.

const HALF_SQRT3 = Math.sqrt(3) / 2;

function centreOf(system, i, j) {
  const [px, py] = system.pitch;
  const [x, y] = system.hex ? [px * (i + 0.5 * j), py * HALF_SQRT3 * j] : [px * i, py * j];
  return [x + system.shear * y, y];
}

// Whether the array has a lenslet with this centre.
function present(system, [x, y]) {
  return Math.abs(x - system.shear * y) <= system.ends[0] && Math.abs(y) <= system.ends[1];
}

function locate(system, [x, y]) {
  const [px, py] = system.pitch;
  const u = (x - system.shear * y) / px;
  if (!system.hex) return [Math.floor(u + 0.5), Math.floor(y / py + 0.5)];
  const v = y / (HALF_SQRT3 * py);
  const i = Math.floor(u - 0.5 * v);
  const j = Math.floor(v);
  const s = u - 0.5 * v - i;
  const t = v - j;
  const q0 = u - (i + 0.5 * j);
  const q1 = 0.5 * s + t;
  if (q0 < 0.5 && q1 < 0.5) return [i, j];
  if (q0 >= 1 && q1 >= 1) return [i + 1, j + 1];
  return t < s ? [i + 1, j] : [i, j + 1];
}

// The lenslet that owns a point of the panel, array's frame. The line from the point to the eye crosses the lenslet's cell.
function owner(system, point) {
  return locate(system, point.map((c, k) => c - (c - system.axis[k]) * system.share));
}

// The panel's point that the eye sees through a point of the array, both in the array's frame.
function behind(system, point) {
  return point.map((c, k) => (c - system.axis[k] * system.share) / (1 - system.share));
}

// Corners of a cell relative to the cell's centre, in the array's frame.
function cellCorners({ hex, pitch, shear }) {
  const count = hex ? 6 : 4;
  const radius = 1 / Math.sqrt(hex ? 3 : 2);
  const first = hex ? Math.PI / 6 : Math.PI / 4;
  return Array.from({ length: count }, (_, k) => {
    const angle = first + (2 * Math.PI * k) / count;
    const y = pitch[1] * radius * Math.sin(angle);
    return [pitch[0] * radius * Math.cos(angle) + shear * y, y];
  });
}

function arrayFromPanel(system, [x, y]) {
  const [cos, sin] = system.turn;
  const [dx, dy] = [x - system.offset[0], y - system.offset[1]];
  return [cos * dx + sin * dy, cos * dy - sin * dx];
}

function panelFromArray(system, [x, y]) {
  const [cos, sin] = system.turn;
  return [cos * x - sin * y + system.offset[0], sin * x + cos * y + system.offset[1]];
}

function panelFromPixel(system, [u, v]) {
  return [(u - system.panelPx[0] / 2) * system.pixelPitch[0], (system.panelPx[1] / 2 - v) * system.pixelPitch[1]];
}

function pixelFromPanel(system, [x, y]) {
  return [x / system.pixelPitch[0] + system.panelPx[0] / 2, system.panelPx[1] / 2 - y / system.pixelPitch[1]];
}
