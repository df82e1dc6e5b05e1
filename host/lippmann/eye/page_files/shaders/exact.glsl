// Traces a ray from the viewer through both faces to the panel, as optics/models.py.

uniform float index;      // refractive index of the glass in air
uniform float thickness;  // distance from vertex to flat face
uniform float gap;        // distance from the panel to the array's nearer face

// The point of the panel plane where a ray from the viewer ends.
struct Landing {
  vec2 point;   // point local to the lenslet that the ray passed; crosstalk if this lenslet does not own the point
  vec2 centre;  // centre of that lenslet, from the centre of the ray's lenslet
};

// `ray` starts on the viewer's face, towards the panel, local to the lenslet whose cell contains its point.
// Returns false if the ray misses, is totally reflected or is blocked.
bool reach_panel(Ray ray, out Landing landing) {
  Crossing met;
#ifdef PLANO_TO_PANEL
  bool through = meet(ray, false, met);
  refract_dome(met, 1.0 / index, false, ray.way);  // no total reflection, because the ray enters the denser medium
  ray.point = met.point;
#ifndef GLANCE
  through = through && !blocked_below(ray);
#endif
  ray.point += (-thickness - ray.point.z) / ray.way.z * ray.way;
  through = refract_flat(ray.way, index) && through;
  float panel_z = -(thickness + gap);
  landing.centre = met.centre;
#else
  // In the mirror image z -> -z the domes also bulge to +z, and the light passes upwards through them.
  ray.way.z = -ray.way.z;
  refract_flat(ray.way, 1.0 / index);
  ray.point.z = -thickness;
  ray.point += (thickness - sag) / ray.way.z * ray.way;
  vec2 moved = centre_of(locate(ray.point.xy));
  ray.point.xy -= moved;
  bool through = meet(ray, true, met);
  through = refract_dome(met, index, true, ray.way) && through;
  ray.point = met.point;
#ifndef GLANCE
  through = through && !blocked_above(ray);
#endif
  float panel_z = gap;
  landing.centre = moved + met.centre;
#endif
  landing.point = ray.point.xy + (panel_z - ray.point.z) / ray.way.z * ray.way.xy;
  return through;
}
