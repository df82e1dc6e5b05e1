// Converts between the frames of panel and array, and returns a pixel's light, as optics/system.py and observer.py.

uniform highp sampler2DArray panel;  // panel values, sRGB, in tiles
uniform ivec2 tile_px;
uniform int tiles_across;
uniform vec2 panel_px;
uniform vec2 pixels_per_mm;     // rows go down
uniform vec2 offset;            // the array's origin in the panel's frame
uniform vec2 turn;              // cos and sin of the array's rotation

vec2 array_from_panel_way(vec2 v) {
  return vec2(turn.x * v.x + turn.y * v.y, turn.x * v.y - turn.y * v.x);
}

vec2 array_from_panel(vec2 point) {
  return array_from_panel_way(point - offset);
}

vec2 panel_from_array(vec2 point) {
  return vec2(turn.x * point.x - turn.y * point.y, turn.y * point.x + turn.x * point.y) + offset;
}

// Pixel coordinates of a point in the panel's frame.
vec2 pixel_from_panel(vec2 point) {
  return pixels_per_mm * point + 0.5 * panel_px;
}

bool on_panel(vec2 pixel) {
  return all(greaterThanEqual(pixel, vec2(0.0))) && all(lessThan(pixel, panel_px));
}

// Returns the panel value of the pixel at coordinates on the panel.
vec3 value_at(vec2 pixel) {
  ivec2 place = ivec2(pixel);
  ivec2 tile = place / tile_px;
  return texelFetch(panel, ivec3(place - tile * tile_px, tile.y * tiles_across + tile.x), 0).rgb;
}

#ifdef EMITS
#ifdef SUBPIXELS
// Left, top, right and bottom of the sub-pixels, and gains for red, green, blue and white, as subpixels.py.
const vec4 boxes[SUBPIXELS] = BOXES, gains[SUBPIXELS] = GAINS;
#endif

// Returns the panel's light at a point of a pixel that shows `light`. A black pixel emits a little light.
vec3 emitted(vec2 pixel, vec3 light) {
  light = BLACK + (1.0 - BLACK) * light;
#ifdef SUBPIXELS
  vec2 place = mod(pixel, PERIOD);
  float darkest = WHITE * min(light.r, min(light.g, light.b));
  vec4 parts = vec4(light - darkest, darkest), sum = vec4(0.0);
  for (int k = 0; k < SUBPIXELS; ++k) {
    bool inside = all(greaterThanEqual(place, boxes[k].xy)) && all(lessThan(place, boxes[k].zw));
    sum += inside ? gains[k] * parts : vec4(0.0);
  }
  light = sum.rgb + sum.a;
#endif
  return light;
}
#endif
