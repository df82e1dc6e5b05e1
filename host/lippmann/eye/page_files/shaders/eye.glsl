// Rays from the pupil through the view's pixels: observe.py, `_eye_rays`.

uniform vec3 eye;         // centre of the pupil, panel's frame
uniform float pupil;      // its diameter; 0 for a pinhole
uniform float focus;      // depth z of the plane in focus
uniform uvec2 window_px;  // the view's pixels ...
uniform vec2 window_mm;   // ... and what they cover of the plane z = 0, centred on the axis

// Column and row of the view, whose first row is the top one.
uvec2 view_pixel(vec2 fragment) {
  return uvec2(fragment.x, window_px.y - 1u - uint(fragment.y));
}

// A ray into the display through a place of the view (pixels) and a point of the pupil (of the unit disk); its point is
// where it crosses the plane at height z. That is worked out from the window, not from the far eye or the plane in
// focus: float32 then keeps it to 30 nm across a panel of 700 mm.
Ray eye_ray(vec2 place, vec2 pupil_point, float z) {
  vec2 share = place / vec2(window_px) - 0.5;
  vec2 seen = vec2(share.x, -share.y) * window_mm;
  vec2 point = seen + z / eye.z * (eye.xy - seen);
  vec3 way = vec3(seen - eye.xy, -eye.z);
#ifndef GLANCE
  if (pupil > 0.0) {
    // On the focused plane a pixel's rays meet, where the one through the pupil's centre crosses it.
    vec2 aside = 0.5 * pupil * pupil_point / (eye.z - focus);
    point += (z - focus) * aside;
    way.xy -= eye.z * aside;
  }
#endif
  return Ray(vec3(point, z), normalize(way));
}
