// The panel: its frame, the array's frame, and the light of a pixel: optics/panel.py, observe.py.

uniform highp sampler2D panel;  // panel values, sRGB
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

#ifdef STRIPES
// A stripe emits its one colour from a third of the pixel, three times as bright there.
vec3 stripe_at(vec2 pixel) {
  int stripe = clamp(int(3.0 * fract(pixel.x)), 0, 2);
  return 3.0 * vec3(equal(ivec3(stripe), STRIPES));
}
#endif
