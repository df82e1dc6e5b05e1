// Moves the eye with the mouse, a finger or the keys over the observer's view.

const KEY_STEP = 0.02; // step of a key, as a fraction of a slider's range
const BIG_STEPS = 5; // factor of the step with Shift

// `move(name, share)` sets a slider to a fraction of its range, `nudge(name, share)` moves a slider by a fraction of its
// range, and `centre()` moves the eye back to the middle. The canvas's width and height span the sliders' ranges.
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
