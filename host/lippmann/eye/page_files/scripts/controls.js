// Reads and sets the page's sliders and boxes by their ids.

const element = (id) => document.getElementById(id);
const number = (id) => element(id).valueAsNumber;
const checked = (id) => element(id).checked;

function sliders() {
  return [...document.querySelectorAll("input[type=range]")];
}

// Writes a slider's value beside the slider, also for screen readers.
function tell(slider) {
  const decimals = (slider.step.split(".")[1] ?? "").length;
  const text = `${slider.valueAsNumber.toFixed(decimals)} ${slider.dataset.unit}`.trim();
  document.querySelector(`output[for="${slider.id}"]`).value = text;
  slider.setAttribute("aria-valuetext", text);
}

function setSlider(id, value) {
  const slider = element(id);
  slider.value = String(value);
  tell(slider);
}

// Sets a slider to a fraction, 0 to 1, of its range.
function setShare(id, share) {
  const slider = element(id);
  setSlider(id, Number(slider.min) + share * (Number(slider.max) - Number(slider.min)));
}

function nudgeSlider(id, share) {
  const slider = element(id);
  setSlider(id, slider.valueAsNumber + share * (Number(slider.max) - Number(slider.min)));
}

// Resets sliders to the page's initial values.
function resetSliders(chosen) {
  for (const slider of chosen) {
    slider.value = slider.defaultValue;
    tell(slider);
  }
}

// Returns the values of the controls: the eye, and the errors of the display as built.
function readControls() {
  return {
    eye: {
      position: [number("eye-x"), number("eye-y"), number("eye-z")],
      pupil: number("pupil"),
      focus: number("focus"),
    },
    built: {
      rotation: number("rotation"),
      offset: [number("offset-x"), number("offset-y")],
      gap: number("gap"),
      pitchScale: number("pitch-scale"),
    },
    crosstalk: checked("crosstalk"),
    seams: checked("seams"),
    marks: checked("marks"),
  };
}
