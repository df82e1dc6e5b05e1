// The eye follows the mouse, a finger, or the keys over the observer's view.

const KEY_STEP = 0.02; // of a slider's range
const BIG_STEPS = 5; // with Shift

// `move(name, value)` sets a slider, `nudge(name, share)` moves it by a share of its range, `centre()` brings the eye
// back to the middle. Across and down the canvas the eye goes through the ranges of its sliders.
function followPointer(canvas, { move, nudge, centre }) {
  const follow = (event) => {
    const box = canvas.getBoundingClientRect();
    move("eye-x", (event.clientX - box.left) / box.width);
    move("eye-y", 1 - (event.clientY - box.top) / box.height);
  };
  canvas.addEventListener("pointermove", follow);
  canvas.addEventListener("pointerdown", follow);
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const share = KEY_STEP * (event.shiftKey ? BIG_STEPS : 1);
    const keys = {
      ArrowLeft: ["eye-x", -share],
      ArrowRight: ["eye-x", share],
      ArrowDown: ["eye-y", -share],
      ArrowUp: ["eye-y", share],
      PageDown: ["eye-z", -share],
      PageUp: ["eye-z", share],
    };
    if (event.key === "Home") centre();
    else if (keys[event.key]) nudge(...keys[event.key]);
    else return;
    event.preventDefault();
  });
}
