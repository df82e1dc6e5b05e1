// Chooses the number of rays per pixel and frame, so that the picture stays fluid.

const SLOW_MS = 28;
const QUICK_MS = 19;
const MOST_RAYS = 16;
// Number of frames to wait before more rays are tried again.
const PATIENCE = 120;
// Number of frames in an average.
const SPAN = 8;

class Pace {
  constructor() {
    this.raysPerFrame = 1;
    this.milliseconds = 1000 / 60;
    this.last = undefined;
    this.wait = SPAN;
  }

  // Records the time of each frame in a sequence of frames.
  tick(now) {
    if (this.last !== undefined) {
      this.milliseconds += (now - this.last - this.milliseconds) / SPAN;
      this.wait -= 1;
      if (this.milliseconds > SLOW_MS && this.raysPerFrame > 1) {
        this.raysPerFrame /= 2;
        this.wait = PATIENCE;
        this.milliseconds = QUICK_MS;
      } else if (this.milliseconds < QUICK_MS && this.wait <= 0 && this.raysPerFrame < MOST_RAYS) {
        this.raysPerFrame *= 2;
        this.wait = SPAN;
      }
    }
    this.last = now;
  }

  // Ends the sequence, so that the time until the next frame does not count.
  rest() {
    this.last = undefined;
  }
}
