// Returns the display as built: the designed display with the sliders' errors, as numbers for shaders and drawing.
// The formulas are those of display/description.py and optics/system.py. Lengths are mm. `display` is the page's JSON.

function systemOf(display, built) {
  const { panel, array } = display;
  const hex = array.grid === "hex";
  const pitch = [array.pitch_mm, array.pitch_mm].flat().slice(0, 2).map((one) => one * built.pitchScale); // one number stands for both
  const shear = array.shear ?? 0;
  const halfDiagonal = Math.max(...cellCorners({ hex, pitch, shear }).map(([x, y]) => Math.hypot(x, y)));
  // Position of the last lenslet within the extent, plus a quarter of a step, where no lenslet is.
  const steps = [pitch[0], pitch[1] * (hex ? HALF_SQRT3 : 1)];
  const ends = steps.map((step, k) =>
    array.extent_mm  // a stretched array keeps its lenslets
      ? 0.5 * step * (Math.floor(((array.extent_mm[k] * built.pitchScale) / step) * (1 + 1e-12)) + 0.5) : 3e38);
  const radius = array.radius_mm;
  const flatDistance = Math.sqrt(Math.max(radius ** 2 - halfDiagonal ** 2, 0));
  const sag = halfDiagonal ** 2 / (radius + flatDistance);
  // If stretching makes the sag larger than the thickness, the thickness grows to the sag.
  const thickness = built.pitchScale > 1 ? Math.max(array.thickness_mm, sag) : array.thickness_mm;
  const gap = Math.max(display.gap_mm + built.gap, 0);
  const rotation = ((array.rotation_deg + built.rotation) * Math.PI) / 180;
  const apertureDistance = array.plano_side === "panel" ? gap + thickness / array.index : Math.max(gap, sag);
  const eye = display.viewing_distance_mm;
  const frame = {
    offset: [array.offset_mm[0] + built.offset[0], array.offset_mm[1] + built.offset[1]],
    turn: [Math.cos(rotation), Math.sin(rotation)],
  };
  return {
    ...frame,
    hex,
    planoToPanel: array.plano_side === "panel",
    pitch,
    shear,
    ends,
    curvature: 1 / radius,
    sag,
    index: array.index,
    thickness,
    gap,
    apertureDistance,
    share: eye === null ? 0 : apertureDistance / (apertureDistance + eye), // fraction of the distance from panel to eye at which the array is
    axis: arrayFromPanel(frame, display.viewing_axis_mm), // point in front of which this eye is, array's frame
    panelPx: [panel.width_px, panel.height_px],
    pixelPitch: [panel.pixel_pitch_mm, panel.pixel_pitch_mm].flat().slice(0, 2), // x and y; one number stands for both
  };
}
