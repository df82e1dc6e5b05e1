// How many rays a pixel gets in a frame: as many as keep the picture moving.

const SLOW_MS = 28;
const QUICK_MS = 19;
const MOST_RAYS = 16;
// Frames to wait before more rays are tried again, and frames that an average spans.
const PATIENCE = 120;
const SPAN = 8;

class Pace {
  constructor() {
    this.raysPerFrame = 1;
    this.milliseconds = 1000 / 60;
    this.last = undefined;
    this.wait = SPAN;
  }

  // Told the time of each frame in a row of frames.
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

  // Told when the row ends: the next frame is no measure.
  rest() {
    this.last = undefined;
  }
}
