// Renders the observer's view. Each pass adds one ray per pixel to a float texture, which is then shown. A glance draws
// one ray per pixel directly on the screen.

class ViewRenderer {
  // `shaders` maps file names to sources. `panel` is the integral image as PanelTiles.
  constructor(canvas, shaders, panel) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error("this browser has no WebGL 2");
    const wide = gl.getExtension("EXT_color_buffer_float");
    if (!wide && !gl.getExtension("EXT_color_buffer_half_float")) {
      throw new Error("this browser's WebGL has no floating-point pictures");
    }
    this.gl = gl;
    this.canvas = canvas;
    this.sumFormat = wide ? gl.RGBA32F : gl.RGBA16F;
    const [glance, look, show] = ["glance", "view", "show"].map((name) => {
      return this.program(shaders["full.vert"], shaders[`${name}.frag`]);
    });
    Object.assign(this, { glanceProgram: glance, lookProgram: look, showProgram: show });
    this.panel = panel;
    this.panelLight = this.panelTexture(panel);
    this.sums = [];
    this.rays = 0;
    gl.bindVertexArray(gl.createVertexArray());
  }

  program(vertex, fragment) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
        throw new Error(`a shader does not compile: ${gl.getShaderInfoLog(shader)}`);
      }
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(`a shader does not link: ${gl.getProgramInfoLog(program)}`);
    }
    const places = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); ++k) {
      const { name } = gl.getActiveUniform(program, k);
      places[name] = gl.getUniformLocation(program, name);
    }
    return { program, places };
  }

  texture(kind = this.gl.TEXTURE_2D) {
    const gl = this.gl;
    const texture = gl.createTexture();
    gl.bindTexture(kind, texture);
    gl.texParameteri(kind, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(kind, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }

  panelTexture(panel) {
    const gl = this.gl;
    const texture = this.texture(gl.TEXTURE_2D_ARRAY);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, ...panel.tile, panel.bitmaps.length);
    this.fillTexture(panel);
    if (![gl.NO_ERROR, gl.CONTEXT_LOST_WEBGL].includes(gl.getError())) {
      throw new Error(`this browser's WebGL has no room for ${panel.width} × ${panel.height} pixels`);
    }
    return texture;
  }

  // Writes a panel's pixels into the bound texture.
  fillTexture(panel) {
    const gl = this.gl;
    panel.forEach((bitmap, _x, _y, layer) => {
      const place = [0, 0, layer, bitmap.width, bitmap.height, 1];
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, ...place, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    });
  }

  // Replaces the panel by another frame of the same size, and clears the summed rays.
  setPanel(panel) {
    this.gl.activeTexture(this.gl.TEXTURE0);
    this.gl.bindTexture(this.gl.TEXTURE_2D_ARRAY, this.panelLight);
    this.fillTexture(panel);
    this.panel = panel;
    this.rays = 0;
  }

  // Sets the canvas's size in pixels, and clears the summed rays.
  resize(width, height) {
    const gl = this.gl;
    this.canvas.width = width;
    this.canvas.height = height;
    for (const { texture, frame } of this.sums) {
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(frame);
    }
    this.sums = [0, 1].map(() => {
      const texture = this.texture();
      gl.texStorage2D(gl.TEXTURE_2D, 1, this.sumFormat, width, height);
      const frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
      return { texture, frame };
    });
    this.rays = 0;
  }

  // Starts a new view of a system for an eye {position, pupil, focus} through a window in mm.
  begin(system, eye, windowMm, crosstalk) {
    const gl = this.gl;
    for (const { program, places } of [this.glanceProgram, this.lookProgram]) {
      gl.useProgram(program);
      gl.uniform1i(places.panel, 0);
      gl.uniform2i(places.tile_px, ...this.panel.tile);
      gl.uniform1i(places.tiles_across, this.panel.across);
      gl.uniform2fv(places.pitch, system.pitch);
      gl.uniform1f(places.shear, system.shear);
      gl.uniform1f(places.slant, system.pitch[0] / system.pitch[1]);
      gl.uniform2fv(places.ends, system.ends);
      gl.uniform1f(places.curvature, system.curvature);
      gl.uniform1f(places.sag, system.sag);
      gl.uniform1f(places.index, system.index);
      gl.uniform1f(places.thickness, system.thickness);
      gl.uniform1f(places.gap, system.gap);
      gl.uniform1f(places.share, system.share);
      gl.uniform2fv(places.axis, system.axis);
      gl.uniform2fv(places.offset, system.offset);
      gl.uniform2fv(places.turn, system.turn);
      gl.uniform2fv(places.panel_px, system.panelPx);
      gl.uniform2f(places.pixels_per_mm, 1 / system.pixelPitch[0], -1 / system.pixelPitch[1]);
      gl.uniform3fv(places.eye, eye.position);
      gl.uniform1f(places.pupil, eye.pupil);
      gl.uniform1f(places.focus, eye.focus);
      gl.uniform2ui(places.window_px, this.canvas.width, this.canvas.height);
      gl.uniform2fv(places.window_mm, windowMm);
      gl.uniform1i(places.crosstalk, crosstalk);
    }
    this.rays = 0;
  }

  // Runs a program over all pixels of a framebuffer (null is the canvas), with a second texture beside the panel's texture.
  run({ program, places }, frame, beside, uniforms = () => {}) {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.panelLight);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, beside);
    uniforms(places);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Shows the view with one ray per pixel, from the pixel's centre to the pupil's centre.
  glance() {
    this.run(this.glanceProgram, null, null);
  }

  // Adds `count` rays to each pixel and shows the mean.
  draw(count) {
    const gl = this.gl;
    for (let k = 0; k < count; ++k) {
      const [before, after] = this.sums;
      this.run(this.lookProgram, after.frame, before.texture, (places) => {
        gl.uniform1i(places.light_before, 1);
        gl.uniform1ui(places.ray_number, this.rays);
      });
      this.sums = [after, before];
      this.rays += 1;
    }
    this.run(this.showProgram, null, this.sums[0].texture, (places) => gl.uniform1i(places.light, 1));
  }
}
