// Starts the page, and draws when something changes.

const MOST_RAYS_AT_REST = 64;
const SPEAK_AFTER_MS = 600;
const SWAY_SECONDS = 6;

class Viewer {
  constructor(display, shaders, directs, frames) {
    this.display = display;
    this.shaders = shaders;
    this.frames = frames;
    this.panel = frames[0];
    this.pace = new Pace();
    this.direct = new DirectView(directs);
    this.panelView = new PanelView(element("panel-canvas"), this.panel, () => this.panelChanged());
    this.canvas = element("view-canvas");
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => this.startView());
    this.startView();
    this.listen();
    new ResizeObserver(() => this.resized()).observe(this.canvas.parentElement);
  }

  // A browser without WebGL 2 shows everything except the view.
  startView() {
    try {
      this.renderer = new ViewRenderer(this.canvas, this.shaders, this.panel);
      this.resized();
    } catch (error) {
      this.renderer = undefined;
      complain(`No observer's view: ${error.message}.`);
    }
  }

  listen() {
    const set = (change) => (...values) => {
      change(...values);
      this.changed();
    };
    followPointer(this.canvas, {
      move: set(setShare),
      nudge: set(nudgeSlider),
      centre: set(() => resetSliders(sliders().filter(({ id }) => id.startsWith("eye-")))),
    });
    for (const slider of sliders()) {
      tell(slider);
      slider.addEventListener("input", set(() => tell(slider)));
    }
    element("crosstalk").addEventListener("change", () => this.changed());
    for (const id of ["seams", "marks"]) element(id).addEventListener("change", () => this.panelChanged());
    const click = (id, act) => element(id)?.addEventListener("click", act);
    click("reset", set(() => {
      resetSliders(sliders());
      element("crosstalk").checked = element("crosstalk").defaultChecked;
    }));
    click("zoom-in", () => this.panelView.zoomBy(1.5));
    click("zoom-out", () => this.panelView.zoomBy(1 / 1.5));
    click("zoom-all", () => this.panelView.showAll());
    click("zoom-lenslets", () => this.panelView.showLenslets(this.system));
    click("sway", () => {
      const swaying = element("sway").getAttribute("aria-pressed") !== "true";
      element("sway").setAttribute("aria-pressed", String(swaying));
      this.swayFrom = swaying ? performance.now() : undefined;
      this.changed();
    });
    click("play", () => {
      const playing = element("play").getAttribute("aria-pressed") !== "true";
      element("play").setAttribute("aria-pressed", String(playing));
      this.playFrom = playing ? performance.now() : undefined;
      this.changed();
    });
    click("fill", () => this.fill(!this.filled));
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.filled) this.fill(false);
    });
    click("direct-go", set(() => {
      this.direct.shown.eye_mm.forEach((value, k) => setSlider(["eye-x", "eye-y", "eye-z"][k], value));
    }));
    element("theme").addEventListener("change", ({ target }) => {
      document.documentElement.style.colorScheme = target.value;
    });
  }

  // Shows a frame of a film.
  setFrame(number) {
    this.panel = this.frames[number];
    this.panelView.panel = this.panel;
    this.renderer?.setPanel(this.panel);
    element("frame-words").value = `Frame ${number + 1} of ${this.frames.length}`;
    this.stale = true;
    this.panelStale = true;
  }

  get filled() {
    return element("fill").getAttribute("aria-pressed") === "true";
  }

  // Makes the view fill the window, or returns the view to its place.
  fill(wanted) {
    element("fill").setAttribute("aria-pressed", String(wanted));
    this.canvas.parentElement.classList.toggle("filled", wanted);
    if (wanted) this.canvas.focus();
    else element("fill").focus();
  }

  resized() {
    const ratio = Math.min(devicePixelRatio, 2);
    for (const canvas of [this.canvas, this.panelView.canvas]) {
      const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
      const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
      if (canvas === this.canvas) {
        this.renderer?.resize(width, height);
      } else if (canvas.width !== width || canvas.height !== height) {
        canvas.width = width;
        canvas.height = height;
      }
    }
    this.panelStale = true;
    this.changed();
  }

  get panelMm() {
    const { width_px, height_px, pixel_pitch_mm } = this.display.panel;
    const [x, y] = [pixel_pitch_mm, pixel_pitch_mm].flat();
    return [width_px * x, height_px * y];
  }

  // The window around the panel with the aspect ratio of the canvas.
  get windowMm() {
    const [width, height] = this.panelMm;
    const pixel = Math.max(width / this.canvas.width, height / this.canvas.height);
    return [pixel * this.canvas.width, pixel * this.canvas.height];
  }

  changed() {
    this.stale = true;
    this.waiting ??= requestAnimationFrame((now) => this.frame(now));
  }

  // The panel's picture changed, but not the eye's view.
  panelChanged() {
    this.panelStale = true;
    this.waiting ??= requestAnimationFrame((now) => this.frame(now));
  }

  // Reads the controls, and starts a new view.
  update() {
    const now = readControls();
    this.system = systemOf(this.display, now.built);
    this.renderer?.begin(this.system, now.eye, this.windowMm, now.crosstalk);
    this.direct.update(now.eye);
    drawDepth(now.eye);
    clearTimeout(this.speaking);
    this.speaking = setTimeout(() => {
      element("view-words").textContent = `${eyeInWords(now.eye)} ${focusInWords(now.eye)}`;
    }, SPEAK_AFTER_MS);
  }

  // Names the panel pixel under the pointer.
  tellPixel() {
    const words = element("panel-words");
    const at = this.panelView.hover;
    const pixel = at && this.panelView.pixelAt(at).map(Math.floor);
    if (!pixel || pixel.some((c, k) => c < 0 || c >= this.system.panelPx[k])) {
      words.value = `${this.panelView.scale.toPrecision(2)} screen pixels for a panel pixel`;
      return;
    }
    const centre = panelFromPixel(this.system, pixel.map((c) => c + 0.5));
    const [i, j] = owner(this.system, arrayFromPanel(this.system, centre));
    words.value = `Pixel (${pixel.join(", ")}), lenslet (${i}, ${j})`;
  }

  frame(now) {
    this.waiting = undefined;
    if (this.swayFrom !== undefined) {
      setShare("eye-x", 0.5 + 0.4 * Math.sin((2 * Math.PI * (now - this.swayFrom)) / (1000 * SWAY_SECONDS)));
      this.stale = true;
    }
    if (this.playFrom !== undefined) {
      const rate = Number(element("play").dataset.rate);
      const number = Math.floor(((now - this.playFrom) / 1000) * rate) % this.frames.length;
      if (this.frames[Math.max(number, 0)] !== this.panel) this.setFrame(Math.max(number, 0));
      this.waiting ??= requestAnimationFrame((next) => this.frame(next));
    }
    const moved = this.stale;
    if (moved) {
      this.stale = false;
      this.update();
      this.panelStale ||= this.panelView.lensletsDrawn || this.panelView.showsLenslets(this.system);
    }
    if (this.panelStale) {
      this.panelStale = false;
      const now = readControls();
      this.panelView.draw(this.system, now.eye, now);
      this.tellPixel();
    }
    if (this.renderer && this.renderer.rays < MOST_RAYS_AT_REST) {
      this.pace.tick(now);
      if (moved && this.pace.raysPerFrame === 1) this.renderer.glance();
      else this.renderer.draw(Math.min(this.pace.raysPerFrame, MOST_RAYS_AT_REST - this.renderer.rays));
      element("rate").value = `${Math.round(1000 / this.pace.milliseconds)} frames/s`;
      this.waiting ??= requestAnimationFrame((next) => this.frame(next));
    } else {
      this.pace.rest();
      element("rate").value = "at rest";
    }
  }

  // For scripts and tests: draws a view of width x height pixels with `rays` rays per pixel (0 is a glance), and returns
  // the data URL of a PNG. `settings` has the form of `readControls`; missing values come from the controls.
  picture(settings, width, height, rays) {
    const { eye, built, crosstalk } = { ...readControls(), ...settings };
    this.renderer.resize(width, height);
    this.renderer.begin(systemOf(this.display, built), eye, this.panelMm, crosstalk);
    if (rays) this.renderer.draw(rays);
    else this.renderer.glance();
    const url = this.canvas.toDataURL("image/png");
    this.resized();
    return url;
  }
}

function complain(message) {
  const place = element("trouble");
  place.textContent = message;
  place.hidden = false;
}

async function start() {
  const data = (id) => JSON.parse(element(id).textContent);
  const display = data("display");
  return new Viewer(display, data("shaders"), data("directs"), await framesOfPage(display.panel));
}

globalThis.lippmann = { viewer: start() };
globalThis.lippmann.viewer.catch((error) => complain(`The page cannot start: ${error.message}.`));
