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
// where it crosses the plane at height z. That is worked out from the window, not from the far eye: float32 then keeps
// it to 30 nm across a panel of 700 mm.
Ray eye_ray(vec2 place, vec2 pupil_point, float z) {
  vec2 share = place / vec2(window_px) - 0.5;
  vec3 seen = vec3(share.x * window_mm.x, -share.y * window_mm.y, 0.0);
  vec3 from = eye;
#ifndef GLANCE
  if (pupil > 0.0) {
    // The line through the pupil's centre says which point of the focused plane this pixel shows.
    seen = vec3(seen.xy + (eye.xy - seen.xy) * (focus / eye.z), focus);
    from.xy += 0.5 * pupil * pupil_point;
  }
#endif
  vec3 way = seen - from;
  return Ray(vec3(seen.xy + (z - seen.z) / way.z * way.xy, z), normalize(way));
}
