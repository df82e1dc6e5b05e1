// Computes rays from the pupil through the view's pixels, as `eye_rays` of observer.py.

uniform vec3 eye;         // centre of the pupil, panel's frame
uniform float pupil;      // diameter of the pupil; 0 is a pinhole
uniform float focus;      // depth z of the plane in focus
uniform uvec2 window_px;  // size of the view in pixels
uniform vec2 window_mm;   // size of the view in the plane z = 0, mm, centred on the axis

// Column and row of the view, whose first row is the top one.
uvec2 view_pixel(vec2 fragment) {
  return uvec2(fragment.x, window_px.y - 1u - uint(fragment.y));
}

// Returns a ray into the display through a place of the view (pixels) and a point of the pupil (unit disk). The ray's
// point is in the plane at height z. The point is computed from the window and not from the distant eye or the plane in
// focus. So float32 keeps the point accurate to 30 nm across a panel of 700 mm.
Ray eye_ray(vec2 place, vec2 pupil_point, float z) {
  vec2 share = place / vec2(window_px) - 0.5;
  vec2 seen = vec2(share.x, -share.y) * window_mm;
  vec2 point = seen + z / eye.z * (eye.xy - seen);
  vec3 way = vec3(seen - eye.xy, -eye.z);
#ifndef GLANCE
  if (pupil > 0.0) {
    // In the plane in focus, a pixel's rays meet on the ray through the pupil's centre.
    vec2 aside = 0.5 * pupil * pupil_point / (eye.z - focus);
    point += (z - focus) * aside;
    way.xy -= eye.z * aside;
  }
#endif
  return Ray(vec3(point, z), normalize(way));
}
