// Shows the plane in focus, behind or in front of the display, in words and in the drawing.

function mm(value) {
  return `${Math.abs(value).toFixed(Math.abs(value) < 10 ? 1 : 0)} mm`;
}

function sided(value, positive, negative) {
  return Math.abs(value) < 0.05 ? "" : `${mm(value)} ${value > 0 ? positive : negative}`;
}

function focusInWords({ pupil, focus }) {
  if (pupil === 0) return "A pinhole pupil: all depths are sharp. Open the pupil to focus.";
  if (Math.abs(focus) < 0.05) return "In focus: the display itself.";
  return focus > 0
    ? `In focus: ${mm(focus)} in front of the display, where images are real.`
    : `In focus: ${mm(focus)} behind the display, where images are virtual.`;
}

function eyeInWords({ position: [x, y, z] }) {
  const aside = [sided(x, "right", "left"), sided(y, "up", "down")].filter(Boolean).join(", ") || "on the axis";
  return `Eye ${aside}, ${mm(z)} away.`;
}

// The drawing's x axis is z. viewer_page.py writes the scale into the drawing.
function drawDepth(eye) {
  const drawing = element("depth-drawing");
  const { mmPerUnit } = drawing.dataset;
  element("focus-plane").setAttribute("transform", `translate(${eye.focus / Number(mmPerUnit)} 0)`);
  element("focus-plane").toggleAttribute("data-open", eye.pupil > 0);
  element("depth-words").value = focusInWords(eye);
}
