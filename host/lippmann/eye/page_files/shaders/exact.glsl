// From the viewer's side through both faces to the panel: optics/models.py, `_reach_exact`.

uniform float index;      // of the glass, in air
uniform float thickness;  // vertex to flat face
uniform float gap;        // panel to the array's near face

// Where on the panel plane a ray from the world ends.
struct Landing {
  vec2 point;   // local to the lenslet passed; crosstalk where that does not own it
  vec2 centre;  // of that lenslet, from the one that the ray was local to
};

// `ray` stands on the face that the viewer sees, local to the lenslet whose cell it stands in, heading for the panel.
// False: missed, totally reflected or blocked.
bool reach_panel(Ray ray, out Landing landing) {
  Crossing met;
#ifdef PLANO_TO_PANEL
  bool through = meet(ray, false, met);
  refract_dome(met, 1.0 / index, false, ray.way);  // into the denser medium: never reflected
  ray.point = met.point;
#ifndef GLANCE
  through = through && !blocked_below(ray);
#endif
  ray.point += (-thickness - ray.point.z) / ray.way.z * ray.way;
  through = refract_flat(ray.way, index) && through;
  float panel_z = -(thickness + gap);
  landing.centre = met.centre;
#else
  // Seen in the mirror z -> -z the domes bulge to +z here too, and the light goes up through them.
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
