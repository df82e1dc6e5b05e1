// The whole way: eye, lenslets, panel.

#include "lattice.glsl"
#include "dome.glsl"
#include "flat.glsl"
#include "exact.glsl"
#include "eye.glsl"
#include "panel.glsl"

uniform bool crosstalk;  // whether pixels are seen that the lenslet does not own
uniform float share;     // of the way from the panel to the eye on which elemental images converge: the array is there
uniform vec2 axis;       // that eye is in front of it, array's frame

#ifdef PLANO_TO_PANEL
#define NEAREST_FACE 0.0
#else
#define NEAREST_FACE thickness
#endif

// Pixel coordinates that a ray from the eye, its point on the viewer's face, ends at. False: it sees black.
bool look(Ray ray, out vec2 pixel) {
  ray.way.xy = array_from_panel_way(ray.way.xy);
  vec2 point = array_from_panel(ray.point.xy);
  vec2 centre = centre_of(locate(point));
  ray.point.xy = point - centre;
  Landing landing;
  bool seen = reach_panel(ray, landing);
  centre += landing.centre;
  seen = seen && present(centre);
  if (!crosstalk) seen = seen && holds(landing.point * (1.0 - share) - (centre - axis) * share);
  pixel = pixel_from_panel(panel_from_array(centre + landing.point));
  return seen && on_panel(pixel);
}
