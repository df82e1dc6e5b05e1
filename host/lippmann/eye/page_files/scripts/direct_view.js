// Shows, beside the view, the direct perspective render whose eye is nearest.

class DirectView {
  constructor(directs) {
    this.directs = directs;
    this.shown = undefined;
  }

  // Compares directions, and the logarithm of the distance with a smaller weight.
  nearest([x, y, z]) {
    const apart = ({ eye_mm: [a, b, c] }) => Math.hypot(a / c - x / z, b / c - y / z, 0.1 * Math.log(c / z));
    return this.directs.reduce((best, one) => (apart(one) < apart(best) ? one : best));
  }

  update(eye) {
    if (!this.directs.length) return;
    const one = this.nearest(eye.position);
    if (one !== this.shown) {
      this.shown = one;
      const image = element("direct-image");
      image.src = one.png;
      image.alt = `Direct perspective render. ${eyeInWords({ position: one.eye_mm })}`;
    }
    const off = Math.hypot(...one.eye_mm.map((c, k) => c - eye.position[k]));
    element("direct-words").value =
      `${eyeInWords({ position: one.eye_mm })} ${off < 0.05 ? "The same eye." : `${mm(off)} from the view's eye.`}`;
  }
}
