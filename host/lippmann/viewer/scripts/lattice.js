// Which lenslet a point belongs to, and where lenslets stand: optics/lattice.py, optics/convergence.py, optics/panel.py.

const HALF_SQRT3 = Math.sqrt(3) / 2;

function centreOf(system, i, j) {
  return system.hex
    ? [system.pitch * (i + 0.5 * j), system.pitch * HALF_SQRT3 * j]
    : [system.pitch * i, system.pitch * j];
}

function locate(system, [x, y]) {
  if (!system.hex) return [Math.floor(x / system.pitch + 0.5), Math.floor(y / system.pitch + 0.5)];
  const u = x / system.pitch;
  const v = y / (HALF_SQRT3 * system.pitch);
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

// The lenslet that owns a point of the panel, array's frame: its cell is on the line from there to the eye.
function owner(system, point) {
  return locate(system, point.map((c, k) => c - (c - system.axis[k]) * system.share));
}

// The panel's point that the eye sees through a point of the array, both in the array's frame.
function behind(system, point) {
  return point.map((c, k) => (c - system.axis[k] * system.share) / (1 - system.share));
}

// Corners of a cell, from its centre, in the array's frame.
function cellCorners(system) {
  const count = system.hex ? 6 : 4;
  const radius = system.pitch / Math.sqrt(system.hex ? 3 : 2);
  const first = system.hex ? Math.PI / 6 : Math.PI / 4;
  return Array.from({ length: count }, (_, k) => {
    const angle = first + (2 * Math.PI * k) / count;
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
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
